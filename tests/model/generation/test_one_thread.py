import os
import subprocess
import sys
from pathlib import Path

import pytest
import torch

from model.generation.one_thread import one_thread
from model.generation.windows import GenerateOptions, generate_motion
from model.systems.registry import load_system
from tests.model.made import TINY_SYSTEMS, made_speech, make_weights

ROOT = Path(__file__).parents[3]


def test_one_thread_works_inside_and_as_many_as_before_after_it():
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        with one_thread():
            assert torch.get_num_threads() == 1
        with pytest.raises(ZeroDivisionError), one_thread():
            raise ZeroDivisionError
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(before)


def test_motion_is_made_in_one_thread_whoever_asks(tmp_path):
    system = load_system("globaldiff/global", make_weights(tmp_path, TINY_SYSTEMS))
    seen = []
    options = GenerateOptions(speaker="ann", steps=1)
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        generate_motion(
            system, made_speech(40_000), options, lambda share: seen.append(torch.get_num_threads())
        )
        assert set(seen) == {1}
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(before)


@pytest.mark.parametrize("chosen", [None, "ACTIVE"])
def test_threads_that_wait_sleep_unless_the_user_says_otherwise(chosen):
    environment = {key: value for key, value in os.environ.items() if key != "OMP_WAIT_POLICY"}
    if chosen:
        environment["OMP_WAIT_POLICY"] = chosen
    code = "import model.train, os; print(os.environ['OMP_WAIT_POLICY'])"
    child = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, env=environment, capture_output=True, text=True,
        check=True,
    )  # fmt: skip
    assert child.stdout.strip() == (chosen or "PASSIVE")
