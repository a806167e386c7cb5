"""This project's system that plans first; may import GlobalDiff's family and what systems may."""
