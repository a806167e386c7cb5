"""Conventions shared by the whole project: joints, frame rates, views, and names of motions and
samples. It may import no other package of the project."""
