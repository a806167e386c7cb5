"""The files of a study: videos, page, adapters and records; may import `design`."""
