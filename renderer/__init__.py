"""Bodies, cameras, offscreen pictures, videos and figures."""
