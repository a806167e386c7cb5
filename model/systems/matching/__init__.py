"""The judge of matched and mismatched speech: may import what systems may."""
