"""The sheet that shows where the jitter sits; may import `figures`, not `figure6`."""
