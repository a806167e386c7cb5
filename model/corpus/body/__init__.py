"""How arms, hands, trunk, legs and face carry gestures out; may import gesture, words and people."""
