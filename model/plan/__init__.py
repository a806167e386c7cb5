"""What a body means to do and when, before it moves: gestures, nods, looks and steps with their
times; may import motion and storage.
"""
