"""What the bundled systems generate for a study."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from app.study.design.plan import Clip, Generator, Plan, PlannedSystem
from app.study.make.motions import Source, shown_motions
from model.speech.audio import Speech
from tests.model.made import made_waveform, make_weights

FRAMES = 70


def test_two_clips_move_differently_though_they_hold_the_same_speech(tmp_path: Path) -> None:
    """Two clips that shared noise would show the same gestures, matched or not."""
    weights = make_weights(tmp_path / "weights")
    speech = Speech(made_waveform(16_000 * FRAMES // 30).astype(np.float32), sha256="")
    plan = Plan(
        title="t",
        protocol="pairwise",
        clips=(),
        systems=tuple(
            PlannedSystem(name, generator=Generator("globaldiff/local", steps=steps))
            for name, steps in (("few", 2), ("more", 3))
        ),
        participants=2,
    )
    source = Source(Clip("garden", None, 0.0), FRAMES, speech, {}, {})
    again, other = source, replace(source, clip=Clip("park", None, 0.0))
    poses = [
        shown_motions(plan, each, weights, None, lambda: False)["few"].poses
        for each in (source, again, other)
    ]
    assert np.array_equal(poses[0], poses[1])
    assert np.abs(poses[0] - poses[2]).mean() > 0.001
