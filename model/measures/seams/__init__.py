"""Do windows or codes show where they were put together? May import its siblings in measures."""
