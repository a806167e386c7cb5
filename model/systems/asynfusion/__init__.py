"""AsynFusion: face and body by two branches that hear each other; may import what systems may."""
