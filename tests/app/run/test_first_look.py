"""The example of a fresh page: what the bundled weights make."""

import json
from pathlib import Path

import numpy as np

from app.run.examples import FIRST_LOOK, FIRST_LOOK_METADATA, FIRST_MOTION
from model.motion.motion import load_motion
from tests.app.run.made_first_look import make_first_look


def test_what_is_stored_is_what_the_bundled_weights_make(tmp_path: Path) -> None:
    make_first_look(tmp_path)
    folders = tmp_path, FIRST_LOOK
    ours, stored = (json.loads((folder / FIRST_LOOK_METADATA).read_text()) for folder in folders)
    for part in ("weights", "speech"):
        assert ours["provenance"][part] == stored["provenance"][part], "make it anew"
    own, kept = (load_motion(folder / "viewer" / FIRST_MOTION.name) for folder in folders)
    assert own.num_frames == kept.num_frames == 201
    # Processors differ in the last digits, which ten steps of a flow make larger.
    apart = np.abs(own.local_rotations().numpy() - kept.local_rotations().numpy())
    assert apart.mean() < 3e-3 and apart.max() < 0.2
