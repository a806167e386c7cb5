"""Raters of known taste, to try a study on; may import `statistics` and `design`."""
