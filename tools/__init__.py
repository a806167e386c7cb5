"""Offline tools: making the corpus that the bundled weights were trained on, and the open body.

May import `model`, `renderer`, `processes` and `conventions`; nothing imports it.
"""
