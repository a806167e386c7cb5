"""Runs of equal and of true values, against a slow version."""

from itertools import groupby, product

import numpy as np

from model.motion.runs import equal_runs, true_runs


def test_runs_are_those_of_groupby() -> None:
    for length in range(9):
        for values in product((False, True), repeat=length):
            runs, start = [], 0
            for value, group in groupby(values):
                size = len(list(group))
                runs.append((start, start + size, value))
                start += size
            mask = np.array(values, bool)
            assert true_runs(mask) == [(a, b) for a, b, value in runs if value]
            if length:
                assert equal_runs(mask.astype(int)) == [(a, b) for a, b, _ in runs]
