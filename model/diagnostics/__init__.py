"""All numbers of a motion put together, and what they are called; may import faults, measures and
everything below.
"""
