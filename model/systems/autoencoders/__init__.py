"""Autoencoders, L_m's teacher and the judges of Fréchet distances: may import what systems may."""
