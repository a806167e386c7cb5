"""Systems measured on many clips, with intervals; may import systems, measures and everything
below.
"""
