"""Sound files, transcripts, and speech features at the motion's frame rate; may import plans."""
