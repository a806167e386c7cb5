"""What a visitor waits for, and what each step of it costs; may import all of app but page and
commands."""
