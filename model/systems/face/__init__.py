"""Expression network, used by all systems of GlobalDiff; may import what systems may."""
