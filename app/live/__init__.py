"""Live sessions, all in one process; may import `run`, `config`, `errors` and `text`."""
