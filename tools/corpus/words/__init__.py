"""What is said and how: topics, grammar and prosody; may import people."""
