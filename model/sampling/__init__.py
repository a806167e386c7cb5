"""Flow matching and the linear-Gaussian prior; imports no other package of the model."""
