"""Shared conventions: joints, rates, views, and names of motions; imports no other package."""
