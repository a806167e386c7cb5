"""Quality against time: what is measured is what generation and the measures say."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from app.errors import CancelledRun, RunError
from app.run.experiments.step_curve import MAX_S, StepCurveRequest, measure_step_curve
from app.run.models import get_system
from model.diagnostics import diagnose
from model.generation.windows import GenerateOptions, generate_motion
from model.motion.kinematics import open_body_skeleton
from model.motion.tracks import track_points
from model.speech.audio import load_speech, write_wav


@pytest.fixture(scope="module")
def speech(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("speech") / "s.wav"
    rng = np.random.default_rng(0)
    write_wav(path, 0.1 * rng.normal(size=int(3.0 * 16000)))
    return path


def test_points_are_what_generation_and_measures_say(
    speech: Path, weights: Path, tmp_path: Path
) -> None:
    name = "globaldiff/global"
    request = StepCurveRequest(
        speech, tmp_path / "out", (name,), counts=(1, 3), speaker="ann", seed=5, weights=weights
    )
    shares: list[float] = []
    curve = measure_step_curve(request, shares.append)

    system, skeleton = get_system(name, weights), open_body_skeleton()
    motions = {
        steps: generate_motion(
            system, load_speech(speech), GenerateOptions("ann", seed=5, steps=steps)
        )[0]
        for steps in (1, 3)
    }
    assert [point.steps for point in curve.points] == [1, 3]
    places = {steps: track_points(motion, skeleton).joints for steps, motion in motions.items()}
    apart = np.linalg.norm(places[1] - places[3], axis=-1).mean()
    assert curve.points[0].distance_cm == pytest.approx(100 * apart)
    assert curve.points[1].distance_cm == 0.0
    measures = diagnose({"a": motions[1]}, skeleton).systems["a"]
    assert curve.points[0].tip_jerk_m_s3 == pytest.approx(measures.raw.point.tip_jerk_m_s3)
    assert all(point.ms_per_frame > 0 and point.face_steps is None for point in curve.points)
    assert shares == sorted(shares) and shares[-1] == 1.0

    assert [path.name for path in curve.files] == [
        "steps.json", "steps.csv", "steps.png", "steps.svg", "steps.pdf",
    ]  # fmt: skip
    table = json.loads((tmp_path / "out" / "steps.json").read_text())
    with (tmp_path / "out" / "steps.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["steps"] for row in rows] == ["1", "3"]
    assert table[0]["distance_cm"] == float(rows[0]["distance_cm"])


def test_no_more_than_ten_seconds_are_generated(
    weights: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    long = tmp_path / "long.wav"
    write_wav(long, 0.1 * np.random.default_rng(0).normal(size=int(12.0 * 16000)))
    lengths: list[int] = []

    def watched(system, speech, options):
        lengths.append(speech.num_frames)
        return generate_motion(system, speech, options)

    monkeypatch.setattr("model.generation.windows.generate_motion", watched)
    names = ("globaldiff/global",)
    measure_step_curve(StepCurveRequest(long, tmp_path / "out", names, (1,), weights=weights))
    assert set(lengths) == {int(30 * MAX_S)}


def test_what_is_stopped_leaves_nothing(speech: Path, weights: Path, tmp_path: Path) -> None:
    def stop(share: float) -> None:
        raise CancelledRun

    request = StepCurveRequest(speech, tmp_path / "out", ("globaldiff/global",), weights=weights)
    with pytest.raises(CancelledRun):
        measure_step_curve(request, stop)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("systems", "counts", "says"),
    [
        (("a",), (0,), "from 1 to 1000; got 0"),
        (("a",), (5, 2000), "from 1 to 1000; got 5, 2000"),
        (("a",), (), "got none"),
        ((), (1,), "One to 6 systems are measured at once; got 0"),
        (tuple("abcdefg"), (1,), "got 7"),
    ],
)
def test_what_cannot_be_measured_is_refused(
    systems: tuple[str, ...], counts: tuple[int, ...], says: str
) -> None:
    with pytest.raises(RunError, match=says):
        StepCurveRequest(Path("s.wav"), Path("out"), systems, counts)
