"""Which gestures go with the words, when and where; may import words and people."""
