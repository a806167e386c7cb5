"""Speech features, motion, networks, training, systems, measures, evaluation and the corpus;
imports neither ``app`` nor ``renderer``.
"""
