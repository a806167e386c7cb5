"""Motions as stills and mp4 files, by workers; may import `draw`, `stage` and `body`."""
