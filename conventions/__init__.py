"""What all of the project agrees on: the joints and their tree, rates, and what motions, views and
samples are called. May import nothing of the project."""
