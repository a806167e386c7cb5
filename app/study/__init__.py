"""A blind user study: plan, export, leak test, answers and their statistics."""
