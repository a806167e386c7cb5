"""Figure 6 of the GlobalDiff paper; its panels are in `panels` and `snapshots`."""
