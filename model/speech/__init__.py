"""Speech in: decoding any sound file, and features at the motion's frame rate."""
