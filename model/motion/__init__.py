"""Motion of the SMPL-X skeleton: rotations, kinematics, files, vectors; may import storage."""
