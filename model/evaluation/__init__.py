"""Systems measured on many clips, with intervals; may import systems and all that is below."""
