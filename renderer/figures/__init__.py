"""Figures for papers, by matplotlib; imports no other room of `renderer`."""
