"""GlobalDiff with its authors' checkpoints, if the user has them; may import what systems may."""
