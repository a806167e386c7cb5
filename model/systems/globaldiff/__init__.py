"""GlobalDiff's ladder and our own system on a prior; may import the face and what systems may."""
