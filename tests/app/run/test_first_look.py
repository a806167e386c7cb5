"""The example of a fresh page: made by the weights, or taken from where they have made it."""

from pathlib import Path

import numpy as np

from app.run.examples import STEADY, STORED, TREMBLING, make_first_look, take_stored
from model.motion.motion import load_motion
from tests.app.run.made_first_look import look_in


def test_what_is_stored_is_what_the_bundled_weights_make(tmp_path: Path) -> None:
    made, taken = look_in(tmp_path / "made"), look_in(tmp_path / "taken")
    make_first_look(made)
    assert not taken.is_made
    assert take_stored(taken), "weights or speech have changed: make examples/first_look anew"
    assert taken.is_made
    assert [each.name for each in STORED.iterdir()] == [taken.folder.name], "nothing older"
    assert taken.beginning.read_bytes() == made.beginning.read_bytes()
    for name in (STEADY, TREMBLING):
        own, stored = (load_motion(look.folder / "shown" / f"{name}.npz") for look in (made, taken))
        assert own.num_frames == stored.num_frames == 201
        # Processors differ in the last digits, which ten steps of a flow make larger.
        apart = np.abs(own.local_rotations().numpy() - stored.local_rotations().numpy())
        assert apart.mean() < 3e-3 and apart.max() < 0.2
    facts, others = taken.facts(), made.facts()
    assert facts["noise_rad"] == others["noise_rad"]
    for name, jerk in facts["jerk_m_s3"].items():
        assert abs(jerk - others["jerk_m_s3"][name]) <= 0.05 * jerk + 2


def test_of_other_weights_nothing_is_stored(tmp_path: Path) -> None:
    look = look_in(tmp_path / "kept")
    assert not take_stored(look, stored=tmp_path / "nowhere")
    assert not look.folder.exists()
