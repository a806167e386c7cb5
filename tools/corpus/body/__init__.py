"""How the parts of a body carry gestures out; may import gesture, words and people."""
