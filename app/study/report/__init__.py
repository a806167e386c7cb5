"""Report of a study as text, tables, figures and page; may import `statistics` and `design`."""
