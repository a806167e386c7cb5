"""The speech encoder of our own, which planners hear with: may import what systems may."""
