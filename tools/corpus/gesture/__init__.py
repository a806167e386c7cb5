"""Choice, time and position of gestures for the words of a clip; may import words and people."""
