"""The families of systems, a folder for each, and the registry that knows them; may import
generation and everything below.
"""
