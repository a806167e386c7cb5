"""What each stage costs, beside a naive way, and what a visitor of the page waits for."""
