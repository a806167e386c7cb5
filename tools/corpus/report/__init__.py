"""What the corpus is like beside a real recording, in figures; may import all of the corpus."""
