"""Tabs of the page, with their forms and runs; may import results and everything below."""
