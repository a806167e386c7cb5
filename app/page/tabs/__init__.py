"""The tabs: of each its form and its runs; may import results and what lies below."""
