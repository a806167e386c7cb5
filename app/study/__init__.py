"""Blind user studies, from plan to report; may import `app.run`, not the page or commands."""
