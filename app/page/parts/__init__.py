"""Building blocks of the page; they import nothing else of the page."""
