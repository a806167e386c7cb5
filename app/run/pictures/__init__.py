"""What a run shows: videos, figures, and what is marked in them; may import what a run is told."""
