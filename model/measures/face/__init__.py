"""Does the face live, and with the hands? May import its siblings in measures, but for those that
gather all numbers.
"""
