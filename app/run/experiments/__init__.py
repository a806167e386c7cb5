"""Experiments: each generates or changes motion in several variants and compares the results."""
