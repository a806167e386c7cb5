"""Figures for papers, drawn with matplotlib; imports no other room of `renderer`."""
