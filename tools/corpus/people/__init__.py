"""Speakers of the corpus: skeleton, voice and style; may import motion."""
