"""What speech decides, equal noise on two forms of rotations, and quality against time."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from app.commands.cli import main
from app.errors import Cancelled, RunError
from app.run import models
from app.run.callbacks import RunCallbacks
from app.run.experiments.rotation_noise import NOISY_MOTION_NAMES, compare_rotation_noise
from app.run.experiments.speech_effect import _effect_sentence, measure_speech_effect
from app.run.experiments.step_sweep import MAX_S, measure_step_sweep
from app.run.models import get_system
from app.run.output.run_folder import read_run
from app.run.requests.convert import replace_fields
from app.run.requests.requests import (
    ROTATION_NOISE_VIDEO,
    WITHOUT_NOISE,
    RotationNoiseRequest,
)
from model.diagnostics import diagnose
from model.generation.windows import GenerateOptions, generate_motion
from model.motion.kinematics import open_body_skeleton
from model.motion.motion import load_motion, save_motion
from model.motion.tracks import track_points
from model.sampling.samplers import noise_seed_of_clip
from model.speech.audio import load_speech, write_wav
from model.systems.registry import list_systems
from tests.app.recorded_callbacks import RecordedCallbacks
from tests.app.requests import (
    rotation_noise_request,
    speech_effect_request,
    step_sweep_request,
)
from tests.conftest import MadeOnce
from tests.helpers import csv_rows, smooth_motion_example
from tests.model.made import made_waveform
from tests.model.metrics.test_speech_effect import motion_of
from tests.renderer.video.test_encoder import decoded_frames

WORLD = "globaldiff/global"


@pytest.fixture(scope="module")
def speeches(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, ...]:
    folder = tmp_path_factory.mktemp("speeches")
    for seed, name in enumerate(("one", "two")):
        write_wav(folder / f"{name}.wav", made_waveform(16_000 * 3, seed))
    return tuple(sorted(folder.glob("*.wav")))


def test_each_speech_is_heard_with_each_seed_and_two_speakers_on_the_first(
    speeches: tuple[Path, ...], weights: Path, tmp_path: Path
) -> None:
    callbacks = RecordedCallbacks()
    out = tmp_path / "out"
    asked: dict[str, Any] = {"systems": (WORLD,), "weights": weights, "guidance": 4.0}
    both = ("bob", "ann")
    measure_speech_effect(
        speech_effect_request(out=out, inputs=speeches, speakers=both, **asked), callbacks
    )
    assert callbacks.shares == pytest.approx([k / 8 for k in range(9)])
    record = read_run(out)
    assert sorted(record.result_files) == [
        *(f"globaldiff-global__{stem}__{seed}.npz" for stem in ("one", "two") for seed in (0, 1)),
        "run.json",
        *(f"speech_effect.{ending}" for ending in ("csv", "json", "pdf", "png", "svg", "txt")),
    ]
    options = GenerateOptions("ann", seed=1, guidance=4.0)
    (expected,) = generate_motion(get_system(WORLD, weights), load_speech(speeches[1]), options)
    made = load_motion(out / "globaldiff-global__two__1.npz")
    np.testing.assert_array_equal(made.poses, expected.poses)
    told = json.loads((out / "speech_effect.json").read_text())[WORLD]
    assert told["guidance"] == 4.0
    arms = told["parts"]["arms"]
    assert arms["by_speech"] == pytest.approx(arms["same_speech"] - arms["neither"])
    assert (
        (out / "speech_effect.txt").read_text().endswith("Metrics follow protocol workbench/1.\n")
    )
    rows = csv_rows(out / "speech_effect.csv")
    assert {told["protocol"], *(row["protocol"] for row in rows)} == {"workbench/1"}
    assert [row["part"] for row in rows] == ["arms", "head", "brows", "jaw"]
    assert float(rows[0]["by_noise"]) == pytest.approx(arms["by_noise"])
    assert np.asarray(Image.open(out / "speech_effect.png").convert("L")).std() > 10
    speakers, (note,) = told["speakers"], record.notes
    assert speakers["calm"] == "bob" and 0 < speakers["calm_over_lively"]
    assert f"bob's wrists move {speakers['calm_over_lively']:.2f} times" in note
    assert record.state == "done" and record.message == "Compared 1 system."
    # What was generated is what a folder of anyone's motion would be, and gives the same numbers.
    (tmp_path / "motions").mkdir()
    for path in out.glob("*.npz"):
        path.rename(tmp_path / "motions" / path.name)
    measure_speech_effect(
        speech_effect_request(out=tmp_path / "again", inputs=(tmp_path / "motions",))
    )
    (again,) = json.loads((tmp_path / "again" / "speech_effect.json").read_text()).values()
    assert again["parts"] == told["parts"] and again["guidance"] is None


@pytest.mark.slow  # processes read their models
def test_processes_beside_each_other_generate_the_same_motions_for_the_speech_effect(
    speeches: tuple[Path, ...],
    weights: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked: dict[str, Any] = {"systems": (WORLD,), "weights": weights, "speakers": ("bob", "ann")}
    for name, worth_s in (("here", models.WORTH_S), ("beside", 0.0)):
        monkeypatch.setattr(models, "WORTH_S", worth_s)
        callbacks = RecordedCallbacks()
        measure_speech_effect(
            speech_effect_request(out=tmp_path / name, inputs=speeches, **asked), callbacks
        )
        assert callbacks.shares == pytest.approx([k / 8 for k in range(9)])
    here, beside = (read_run(tmp_path / name) for name in ("here", "beside"))
    assert here.result_files == beside.result_files
    motions = [name for name in here.result_files if name.endswith(".npz")]
    assert len(motions) == 4
    for name in motions:
        one, other = (load_motion(tmp_path / way / name) for way in ("here", "beside"))
        for part in ("poses", "trans", "expressions"):
            np.testing.assert_array_equal(getattr(one, part), getattr(other, part))
    one, other = (
        (tmp_path / way / "speech_effect.json").read_bytes() for way in ("here", "beside")
    )
    assert one == other
    with pytest.raises(Cancelled):
        stopped = speech_effect_request(out=tmp_path / "stopped", inputs=speeches, **asked)
        measure_speech_effect(stopped, RunCallbacks(should_cancel=lambda: True))
    assert not (tmp_path / "stopped").exists()


def test_a_planted_ear_is_found_in_anyones_motion(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One system whose arms speech decides, one that hears nothing."""
    (tmp_path / "motions").mkdir()
    for name, share in (("hears", 0.9), ("deaf", 0.0)):
        for speech, seed in np.ndindex(3, 2):
            motion = motion_of(speech, seed, share)
            save_motion(motion, tmp_path / "motions" / f"{name}__s{speech}__{seed}.npz")
    out = tmp_path / "out"
    assert main(["hearing", str(tmp_path / "motions"), "--out", str(out)]) == 0
    told = json.loads((out / "speech_effect.json").read_text())
    assert told["hears"]["parts"]["arms"]["by_speech"] > 0.7
    assert told["deaf"]["parts"]["arms"]["by_speech"] < 0.2
    assert told["deaf"]["parts"]["arms"]["by_noise"] > 0.7
    shown = capsys.readouterr()
    assert "hears: compared with pairs of motions that share neither" in shown.err
    assert shown.out.splitlines() == [
        str(out / name)
        for name in (
            "run.json",
            *(f"speech_effect.{kind}" for kind in ("json", "csv", "png", "svg", "pdf", "txt")),
        )
    ]
    with pytest.raises(SystemExit):
        main(["hearing", "a.wav", "b.wav", "--out", str(tmp_path / "no"), "--speakers", "bob"])
    assert "as CALM,LIVELY; got 'bob'" in capsys.readouterr().err


@given(
    shares=st.tuples(*[st.floats(-0.3, 1.0)] * 2),
    reach=st.floats(0.0, 1.0),
)
def test_speech_decides_more_only_where_the_printed_interval_says_so(
    shares: tuple[float, float], reach: float
) -> None:
    by_speech, by_noise = shares
    lead = by_speech - by_noise
    arms = {"by_speech": by_speech, "by_noise": by_noise, "lead": lead}
    arms |= {"lead_low": lead - reach, "lead_high": lead + reach}
    said = _effect_sentence("a", {"parts": {"arms": arms}, "arm_rotations_same_noise": 0.5})
    speech, chance, _, low, high = (
        float(each.replace("\N{MINUS SIGN}", "-"))
        for each in re.findall(r"\N{MINUS SIGN}?\d+\.\d\d", said)[:5]
    )
    assert ("more on the speech" in said) == (low > 0)
    assert ("more on the noise seed" in said) == (high < 0)
    assert ("not significant" in said) == (low <= 0 <= high)
    if "more on the speech" in said:
        assert speech >= chance  # both are rounded
    if "more on the noise seed" in said:
        assert speech <= chance


def test_what_cannot_be_compared_is_told(tmp_path: Path) -> None:
    for changes, sentence in [
        ({"inputs": ("one.wav",)}, "From 2 to 8 speech recordings can be compared; got 1"),
        ({"inputs": ("a/one.wav", "b/one.wav")}, "the same name"),
        ({"num_seeds": 1}, "2 to 8; got 1"),
        ({"systems": ()}, "One to"),
        ({"inputs": (tmp_path,), "speakers": ("ann", "bob")}, "cannot be used with a folder"),
    ]:
        asked = {"inputs": ("one.wav", "two.wav"), "systems": (WORLD, "gan/5")} | changes
        asked["inputs"] = tuple(map(Path, asked["inputs"]))
        with pytest.raises(RunError, match=sentence):
            speech_effect_request(out=tmp_path, **asked).check()


@pytest.mark.parametrize(
    ("names", "sentence"),
    [
        (["what.npz"], "SYSTEM__SPEECH__SEED.npz"),
        (["a__one__0.npz", "a__one__1.npz"], "two speech recordings and two noise seeds"),
        ([], "found 0"),
    ],
)
def test_a_folder_that_says_too_little_is_told(
    names: list[str], sentence: str, tmp_path: Path
) -> None:
    (tmp_path / "motions").mkdir()
    for number, name in enumerate(names):
        save_motion(motion_of(0, number, 0.5), tmp_path / "motions" / name)
    with pytest.raises(RunError, match=sentence):
        measure_speech_effect(
            speech_effect_request(out=tmp_path / "out", inputs=(tmp_path / "motions",))
        )


@pytest.fixture
def asked(tmp_path: Path) -> RotationNoiseRequest:
    save_motion(smooth_motion_example(12), tmp_path / "motion.npz")
    return rotation_noise_request(
        motion=tmp_path / "motion.npz", out=tmp_path / "out", picture_height_px=256
    )


@pytest.mark.gl
def test_two_bodies_stand_side_by_side_and_the_numbers_are_told(
    asked: RotationNoiseRequest,
) -> None:
    callbacks = RecordedCallbacks()
    compare_rotation_noise(replace_fields(asked, noise_rad=0.05, has_video=True), callbacks)
    frames = decoded_frames(asked.output.out / ROTATION_NOISE_VIDEO)
    assert len(frames) == 12 and frames.shape[2] == 2 * 192
    shares = callbacks.shares
    assert shares == sorted(shares) and shares[-1] == pytest.approx(1.0, abs=0.1)
    record = read_run(asked.output.out)
    told = " ".join(record.notes)
    assert "Noise of 0.05 rad on every joint moves the right middle fingertip" in told
    assert "times as far as with global noise (predicted from lever arms" in told
    assert "This assumes equal noise" in told
    moved = np.abs(np.diff(frames.astype(int), axis=0))
    assert moved[:, :, :192].mean() > moved[:, :, 192:].mean(), "the left one trembles more"

    # Both motions are left for a player.
    assert (
        [row.name for row in record.rows] == [*NOISY_MOTION_NAMES, WITHOUT_NOISE]
        and record.audio
        and record.timeline
    )
    caption = (asked.output.out / "error_growth.txt").read_text()
    assert "error_growth.png" in record.files and "0.05 rad" in caption
    assert "follow protocol workbench/1." in caption
    clean = load_motion(asked.motion)
    rows = record.rows[: len(NOISY_MOTION_NAMES)]
    on_local, on_global = (load_motion(asked.output.out / row.files["motion"]) for row in rows)
    pelvis = slice(0, 3)
    for motion in (on_local, on_global):
        assert motion.num_frames == 12 and abs(motion.poses - clean.poses).max() > 0.02
    assert abs(on_local.poses - on_global.poses)[:, pelvis.stop :].max() > 0.02


def test_a_mechanism_that_cannot_be_is_refused(asked: RotationNoiseRequest) -> None:
    for changes, words in [
        ({"noise_rad": 0.2}, "0.005 to 0.1 rad; got 0.2"),
        ({"noise_rad": 0.0}, "got 0"),
        ({"seed": -1}, "must not be negative"),
        (
            {"out": Path("two.mp4")},
            "must be a folder; the video in it is called rotation_noise.mp4",
        ),
        ({"tracked_point": "pelvis"}, "Joint rotations do not move the pelvis"),
    ]:
        with pytest.raises(RunError, match=words):
            compare_rotation_noise(replace_fields(asked, **changes))


def write_noise(folder: Path, seconds: float) -> None:
    samples = np.random.default_rng(0).normal(size=int(seconds * 16_000))
    write_wav(folder / "speech.wav", 0.1 * samples)


@pytest.fixture(scope="session")
def noise(made_once: MadeOnce) -> Path:
    """Three seconds."""
    return made_once("noise", lambda folder: write_noise(folder, 3.0)) / "speech.wav"


def test_points_are_what_generation_and_measures_say(
    noise: Path, weights: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    asked: dict[str, Any] = {"speech": noise, "systems": (WORLD,), "weights": weights}
    callbacks = RecordedCallbacks()
    ask = step_sweep_request(out=out, speaker="ann", seed=5, step_counts=(1, 3), **asked)
    measure_step_sweep(ask, callbacks)
    table = json.loads((out / "steps.json").read_text())
    system, skeleton, speech = get_system(WORLD, weights), open_body_skeleton(), load_speech(noise)
    seed = noise_seed_of_clip(5, speech.sha256)
    one, three = (
        generate_motion(system, speech, GenerateOptions("ann", seed=seed, steps=steps))[0]
        for steps in (1, 3)
    )
    assert [point["steps"] for point in table] == [1, 3]
    places = [track_points(motion, skeleton).joints for motion in (one, three)]
    apart = np.linalg.norm(places[0] - places[1], axis=-1).mean()
    assert table[0]["distance_cm"] == pytest.approx(100 * apart)
    assert table[1]["distance_cm"] == 0.0
    measures = diagnose({"a": one}, skeleton).systems["a"]
    assert table[0]["tip_jerk_m_s3"] == pytest.approx(measures.raw.point.tip_jerk_m_s3)
    assert all(point["ms_per_frame"] > 0 for point in table)
    assert callbacks.shares == sorted(callbacks.shares) and callbacks.shares[-1] == 1.0
    endings = ("json", "csv", "png", "svg", "pdf", "txt")
    record = read_run(out)
    assert record.result_files == ["run.json", *(f"steps.{ending}" for ending in endings)]
    calm = table[0]["tip_jerk_m_s3"] <= 1.05 * table[1]["tip_jerk_m_s3"]
    words = (
        "with 1 instead of 3"
        if calm
        else "with each smaller number of sampling steps tested, fingertip jerk is over"
    )
    assert record.message == "Measured 2 motions." and words in record.notes[0]
    assert (out / "steps.txt").read_text().endswith("Metrics follow protocol workbench/1.\n")
    rows = csv_rows(out / "steps.csv")
    assert {each["protocol"] for each in (*table, *rows)} == {"workbench/1"}
    assert [row["steps"] for row in rows] == ["1", "3"]
    assert table[0]["distance_cm"] == float(rows[0]["distance_cm"])


def test_no_more_than_ten_seconds_are_generated_and_what_is_stopped_leaves_nothing(
    weights: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_noise(tmp_path, MAX_S + 2)
    lengths: list[int] = []

    def watched(system, speech, options):
        lengths.append(speech.num_motion_frames)
        raise Cancelled

    monkeypatch.setattr("app.run.experiments.step_sweep.generate_motion", watched)
    speech, out = tmp_path / "speech.wav", tmp_path / "out"
    ask = step_sweep_request(
        speech=speech, out=out, systems=(WORLD,), weights=weights, step_counts=(1,)
    )
    with pytest.raises(Cancelled):
        measure_step_sweep(ask)
    assert set(lengths) == {int(30 * MAX_S)} and not (tmp_path / "out").exists()


def test_what_cannot_be_measured_is_refused() -> None:
    for systems, counts, says in [
        (("a",), (0,), "from 1 to 1000; got 0"),
        (("a",), (5, 2000), "from 1 to 1000; got 5, 2000"),
        (("a",), (), "got none"),
        ((), (1,), r"One to 6 systems can be compared at once; got 1\d: .*globaldiff/local, "),
        (tuple("abcdefg"), (1,), "got 7"),
    ]:
        with pytest.raises(RunError, match=says):
            step_sweep_request(
                speech=Path("s.wav"), out=Path("out"), systems=systems, step_counts=counts
            ).check()


def test_all_means_all_systems_of_the_weights(noise, weights, tmp_path):
    ask = step_sweep_request(speech=noise, out=tmp_path / "out", weights=weights, step_counts=(1,))
    measure_step_sweep(ask)
    table = json.loads((ask.output.out / "steps.json").read_text())
    assert {row["system"] for row in table} == {*list_systems(weights)}
