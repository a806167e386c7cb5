"""The tabs, a folder for each; may import results and what lies below."""
