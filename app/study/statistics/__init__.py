"""From answers to numbers: screening, votes and tests; may import `design`."""
