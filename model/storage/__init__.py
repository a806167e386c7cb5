"""Files, npz archives, weights and their cards on disk; imports no other package of the model."""
