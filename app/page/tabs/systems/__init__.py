"""The tab of the systems: how constraints work, steps, whether they hear; may import what tabs
may.
"""
