"""Figure 6 of the GlobalDiff paper; may import `figures`."""
