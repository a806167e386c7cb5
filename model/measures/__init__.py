"""Numbers of a motion, with or without a reference, and what they tell; may import generation."""
