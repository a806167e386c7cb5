"""GlobalDiff's ablation, and this project's system with a prior; may import the face."""
