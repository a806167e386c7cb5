"""What a body means to do and when, before it moves; may import motion and storage."""
