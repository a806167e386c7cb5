"""Who speaks: bones, voice and temperament; may import motion."""
