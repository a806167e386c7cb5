"""What a run is asked for, as typed values that a form or a command line has filled; of `run` it
may import the posing of bodies.
"""
