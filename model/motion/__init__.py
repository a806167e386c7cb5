"""Motion of the SMPL-X skeleton: rotations, kinematics, files, filters and the vectors that
networks see; may import storage.
"""
