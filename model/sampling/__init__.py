"""Flow matching and the linear-Gaussian prior; may import `model.motion`."""
