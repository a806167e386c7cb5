"""Benchmark of waiting times and their parts; may import all of `app` except page and commands."""
