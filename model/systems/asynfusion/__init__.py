"""AsynFusion: face and body in two coupled branches; may import what systems may."""
