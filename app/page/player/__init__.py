"""The player of a run: stage, time line and worst seconds, as the page is told of them; may import
queue, routes, visitors and parts.
"""
