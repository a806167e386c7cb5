"""Layers and networks that several families use; may import storage, motion and sampling."""
