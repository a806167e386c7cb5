"""Motion files as other people's tools write them, read as far as that can be done honestly: what
is missing or different is made up for, and every such change is told in a sentence. May import
motion and storage.
"""
