"""Takes: motions of a run that are generated again after their plan was edited."""
