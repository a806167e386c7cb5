"""Statistics of answers: screening, votes, tests and models; may import `design`."""
