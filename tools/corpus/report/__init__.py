"""Statistics of the corpus compared with real recordings; may import all of the corpus."""
