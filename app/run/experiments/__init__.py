"""Runs of their own: does it hear, how steps change it, how a constraint works; may import all of
`run` that one run is made of.
"""
