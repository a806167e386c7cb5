"""Changes of the plan of a motion, and the motion made again: one take after the other."""
