"""The folder that a run leaves: whole or not there, with what made it."""
