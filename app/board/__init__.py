"""A leaderboard that a lab keeps as one file: results of many sets with where they come from, put
together, and shown as a page. It may import the runs' rooms; the page and commands import it."""
