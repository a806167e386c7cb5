"""One training from the first step to the last, whatever is trained; may import everything below
it: networks, data, sampling, speech, motion and storage.
"""
