"""Motions as stills and mp4 files, by workers; may import `draw`, `scene` and `body`."""
