"""Bodies, pictures, videos and figures from plain arrays; imports nothing of `app` or `model`."""
