"""The videos and pictures of a run; may import what a run is asked for and told."""
