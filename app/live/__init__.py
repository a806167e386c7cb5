"""Live sessions: motion that follows speech while it is spoken, in one process for all sessions.

May import `run`, `config`, `errors` and `text`; knows nothing of the page.
"""
