"""The expression network, which every system of GlobalDiff shows: may import what systems may."""
