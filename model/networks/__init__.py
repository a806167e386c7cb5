"""Layers and networks that several families build on; may import storage, motion and sampling."""
