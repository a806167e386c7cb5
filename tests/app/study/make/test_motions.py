"""What the bundled systems generate for a study."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.errors import RunError
from app.study.design.plan import Clip, Generator, Plan, PlannedSystem, read_plan
from app.study.make.motions import Source, read_sources, shown_motions
from model.generation.clip_noise import clip_seed
from model.generation.windows import GenerateOptions, generate_motion
from model.plan.editing import Gesture, added, deleted
from model.plan.files import read_plan_file
from model.plan.plan import GesturePlan
from model.speech.audio import Speech, write_wav
from model.systems.planned.config import PLANNED
from model.systems.registry import load_system
from tests.model.made import TINY_SYSTEMS, made_waveform, make_weights
from tests.model.systems.planned.made import make_planned_weights

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


def planned_sources(tmp_path: Path, text: str) -> tuple[Plan, tuple[Source, ...]]:
    write_wav(tmp_path / "one.wav", made_waveform(16_000 * 6))
    path = tmp_path / "plan.toml"
    path.write_text(
        'title = "t"\nprotocol = "rating"\nparticipants = 2\nlength_s = 5\n[[clips]]\n'
        f'name = "one"\nspeech = "one.wav"\n{text}'
    )
    plan = read_plan(path)
    return plan, read_sources(plan)


def condition(name: str, more: str) -> str:
    return f'[[systems]]\nname = "{name}"\nsystem = "{PLANNED}"\nsteps = 1\n{more}\n'


def test_a_condition_performs_the_given_plan_and_its_style(tmp_path: Path) -> None:
    weights = make_planned_weights(make_weights(tmp_path / "weights", TINY_SYSTEMS))
    (tmp_path / "plans").mkdir()
    file = tmp_path / "plans" / "one.json"
    added(GesturePlan(5.0), "offer", 2.0, "right").plan.write(file)
    given = read_plan_file(file).plan
    by_hand = 'plan = "plans/{clip}.json"'
    none = "style = { times = { gestures_per_min = 0 } }"
    plan, (source,) = planned_sources(
        tmp_path,
        condition("given", by_hand)
        + condition("none of it", f"{by_hand}\n{none}")
        + condition("drawn", "")
        + condition("drawn none", none),
    )
    assert source.plans == {"given": given, "none of it": given}
    assert source.files["plan of given"] == source.files["plan of none of it"]
    made = shown_motions(plan, source, weights, None, lambda: False)
    empty = deleted(given, Gesture("right", 2.0)).plan
    expected = expected_poses(weights, source, given), expected_poses(weights, source, empty)
    np.testing.assert_array_equal(made["given"].poses[:, 3:66], expected[0][:, 3:66])
    np.testing.assert_array_equal(made["none of it"].poses[:, 3:66], expected[1][:, 3:66])
    assert np.abs(made["drawn"].poses - made["drawn none"].poses).max() > 1e-3


def expected_poses(weights: Path, source: Source, plan: GesturePlan) -> np.ndarray:
    system = load_system(PLANNED, weights)
    options = GenerateOptions(
        next(iter(system.speakers)), seed=clip_seed(0, "one"), steps=1, plans=(plan,)
    )
    assert source.speech is not None
    (motion,) = generate_motion(system, source.speech, options)
    return motion.poses


def test_plans_of_other_lengths_and_none_are_refused_before_anything_is_made(
    tmp_path: Path,
) -> None:
    text = condition("given", 'plan = "{clip}.json"')
    with pytest.raises(RunError, match="The plan of 'given' for clip 'one' is missing"):
        planned_sources(tmp_path, text)
    GesturePlan(9.0).write(tmp_path / "one.json")
    with pytest.raises(RunError, match=r"for clip 'one': The plan is of 9\.00 s and the speech"):
        planned_sources(tmp_path, text)
