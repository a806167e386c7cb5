"""Our own system that plans first; may import GlobalDiff's family and what systems may."""
