"""The authors' own checkpoints of GlobalDiff, if a person has them; may import what systems may."""
