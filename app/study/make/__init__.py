"""Files of a study: videos, page and records; may import `design`."""
