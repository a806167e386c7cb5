"""Files, npz archives, weights and their cards on disk; imports no other room."""
