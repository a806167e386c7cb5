"""Speech in, motion out: rotations, skeleton, networks, training and measures."""
