"""Sound files and transcripts to features at the motion's frame rate; may import plans."""
