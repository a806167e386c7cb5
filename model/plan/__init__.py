"""Gesture plans: what a body is to do and when; may import motion and storage."""
