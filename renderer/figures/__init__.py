"""Figures for papers, drawn with matplotlib; imports no other package of `renderer`."""
