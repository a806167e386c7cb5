"""Rates of motion and speech."""

FPS = 30
"""Motion frames per second."""
SAMPLE_RATE = 16_000
"""Speech samples per second, mono."""
