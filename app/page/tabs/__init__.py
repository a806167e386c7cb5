"""The tabs, each with its form and its runs; may import results, serving and parts."""
