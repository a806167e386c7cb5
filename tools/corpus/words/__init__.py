"""Text and speech of the corpus: topics, grammar and prosody; may import people."""
