"""Visitors, their runs and files for them alone; of the page it may import parts."""
