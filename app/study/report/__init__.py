"""The numbers as text, tables, figures and a page; may import `statistics` and `design`."""
