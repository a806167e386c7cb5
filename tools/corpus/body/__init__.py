"""Animation of the body's parts from gestures and speech; may import gesture, words and people."""
