"""Motion files of other tools, read with a report of all assumptions; may import motion."""
