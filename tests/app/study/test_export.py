"""An export is whole, blind, equal in everything but the motion, and can be interrupted."""

import json
import shutil
import stat
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.commands.cli import main
from app.errors import Cancelled, RunError
from app.run.callbacks import RunCallbacks
from app.study.design.blinding import NOT_RENDERED
from app.study.design.key import read_key, write_key
from app.study.design.plan import StudyPlan, read_study_plan
from app.study.export import export_study
from app.study.leaks import find_leaks
from app.study.make import media
from app.study.make.export_folders import ExportFolders
from model.motion.motion import load_motion, save_motion
from model.speech.audio import write_wav
from model.storage.files import file_sha256
from tests.app.study.made_study import (
    CLIPS,
    FRAMES,
    SYSTEMS,
    copy_study,
    draw_noise,
    tree,
    write_inputs,
    write_plan,
)
from tests.helpers import smooth_motion_example

TWO, HERE = SYSTEMS[:2], CLIPS[:2]


class Killed(BaseException):
    """What a signal does to a program: nothing of ours catches it."""


@pytest.fixture
def inputs(tmp_path: Path) -> Path:
    """Motions and speech of two systems and two clips."""
    write_inputs(tmp_path / "inputs", TWO, HERE)
    return tmp_path / "inputs"


def plan_of(folder: Path, settings: str = "", clips: list[str] = HERE) -> StudyPlan:
    return read_study_plan(write_plan(folder, TWO, clips, settings))


def whole_plan(study: Path) -> StudyPlan:
    """That of the study that all tests share."""
    return read_study_plan(study.parent / "plan.toml")


def kill_at(number: int):
    """A renderer that is killed when it starts its nth video."""
    started = []

    def start(key: tuple[str, str]) -> None:
        started.append(key)
        if len(started) == number:
            raise Killed

    return partial(draw_noise, on_start=start)


def test_a_study_is_whole_private_and_equal_in_all_but_the_motion(silent_study, spoken_study):
    for folder, num_videos, num_tracks in ((silent_study, 12, 1), (spoken_study, 8, 2)):
        study = ExportFolders(folder)
        key = read_key(study.key)
        assert len(key.videos) == num_videos and key.inputs_digest
        assert json.loads(study.key.read_text())["made_of"] == key.inputs_digest
        for clip in {video.clip for video in key.videos.values()}:
            files = [
                media.read_mp4(study.video(b)) for b, v in key.videos.items() if v.clip == clip
            ]
            assert len({file.num_bytes for file in files}) == 1
            assert {len(file.tracks[0].sample_sizes) for file in files} == {FRAMES}
            assert {len(file.tracks) for file in files} == {num_tracks}
        assert {path.name for path in study.private.iterdir()} == {
            *("key.json", "manifest.json", "provenance.json", "preregistration.md", "adapters"),
            "README.md",
        }
        assert {path.name for path in study.bundle.iterdir()} == {
            *("index.html", "study.js", "study.css", "study-data.js", "media", "README.txt"),
            *("inter.woff2", "inter-OFL.txt"),
        }
        assert stat.S_IMODE(study.private.stat().st_mode) == 0o700
        assert stat.S_IMODE(study.key.stat().st_mode) == 0o600
        manifest = json.loads((study.private / "manifest.json").read_text())
        assert manifest["balance"]["first_place_spread_within_trial"] == 0
        assert manifest["clips"]["kitchen"] == {
            **{"speech": "kitchen.wav", "start_s": 0.0, "frames": FRAMES}
        }


@pytest.mark.parametrize("protocol", ["ranking", pytest.param("rating", marks=pytest.mark.slow)])
def test_the_other_protocols_export_without_a_leak(inputs, tmp_path, protocol):
    events: list[Any] = []
    plan = plan_of(inputs, f'protocol = "{protocol}"', HERE[:1])
    export_study(plan, tmp_path / "out", draw=draw_noise, callbacks=RunCallbacks(events.append))
    assert find_leaks(tmp_path / "out") == []
    shares = [event.fraction for event in events]
    assert shares[-1] == 1.0 and shares == sorted(shares)


def test_a_killed_export_keeps_its_key_and_ends_as_one_that_was_not(inputs, tmp_path):
    """Nothing catches what ends it, in the first scene and in the second."""
    plan, out = plan_of(inputs), tmp_path / "a"
    with pytest.raises(Killed):
        export_study(plan, out, draw=kill_at(1))
    first = read_key(ExportFolders(out).key)
    with pytest.raises(Killed):
        export_study(plan, out, draw=kill_at(4))
    made = [video.sha256 for video in read_key(ExportFolders(out).key).videos.values()]
    assert sum(digest != NOT_RENDERED for digest in made) == 2
    (out / "participant_bundle" / "media" / ".0123.part.mp4").write_bytes(b"half")
    study = export_study(plan, out, draw=draw_noise)
    key = read_key(study.key)
    assert (key.videos.keys(), list(key.trials)) == (first.videos.keys(), list(first.trials))
    other = ExportFolders(tmp_path / "b")
    other.private.mkdir(parents=True)
    blank = {name: replace(video, sha256=NOT_RENDERED) for name, video in key.videos.items()}
    write_key(replace(key, videos=blank), other.key)  # keys are drawn: it gets that of the first
    export_study(plan, tmp_path / "b", draw=draw_noise)
    assert tree(other.bundle) == tree(study.bundle)
    assert other.key.read_bytes() == study.key.read_bytes()


def test_a_rate_missed_in_half_a_second_is_no_leak(inputs, tmp_path, monkeypatch):
    """Of these pictures the encoder makes 8 % less and 3 % more than it was asked for."""
    monkeypatch.setattr(media, "RATE_STEP_BETWEEN_VIDEOS", 0.0)
    draw = partial(draw_noise, seeds=[56, 128])
    export_study(plan_of(inputs, clips=HERE[:1]), tmp_path / "study", draw=draw)
    assert find_leaks(tmp_path / "study") == []


def test_finished_videos_the_secret_and_the_plan_are_kept_and_damaged_videos_made_anew(
    silent_study, tmp_path
):
    plan, study = whole_plan(silent_study), copy_study(silent_study, tmp_path / "out")
    before, drawn = tree(study.bundle), []
    assert main(["study", "links", str(tmp_path / "out"), "--address", "https://a.example/"]) == 0
    key = study.key.read_bytes()
    assert read_key(study.key).link_secret is not None
    again = partial(draw_noise, on_start=drawn.append)
    export_study(plan, tmp_path / "out", draw=again)
    assert drawn == [] and study.key.read_bytes() == key
    damaged = next(b for b, v in read_key(study.key).videos.items() if v.clip == "garden")
    study.video(damaged).write_bytes(b"damaged")
    export_study(plan, tmp_path / "out", draw=again)
    assert sorted(name for name, _ in drawn) == sorted(
        SYSTEMS
    )  # the whole scene, as its files must be equal
    assert tree(study.bundle) == before
    with pytest.raises(RunError, match="contains the export of another plan"):
        export_study(replace(plan, seed=3), tmp_path / "out", draw=draw_noise)
    inputs = shutil.copytree(silent_study.parent, tmp_path / "inputs")
    save_motion(smooth_motion_example(FRAMES, seed=99), inputs / "localnet-garden.npz")
    with pytest.raises(RunError, match="one of its files was changed"):
        export_study(read_study_plan(inputs / "plan.toml"), tmp_path / "out", draw=draw_noise)


def test_cancelling_leaves_what_is_finished(inputs, tmp_path):
    def cancelled(jobs, should_cancel, **rest) -> None:
        assert should_cancel()
        raise Cancelled

    callbacks = RunCallbacks(should_cancel=lambda: True)
    with pytest.raises(Cancelled):
        export_study(plan_of(inputs), tmp_path / "out", draw=cancelled, callbacks=callbacks)
    assert read_key(tmp_path / "out" / "researcher_only" / "key.json").num_participants_planned == 4


def test_a_folder_of_something_else_is_refused(inputs, tmp_path):
    (tmp_path / "out" / "participant_bundle").mkdir(parents=True)
    (tmp_path / "out" / "participant_bundle" / "thesis.txt").write_text("years of work")
    with pytest.raises(RunError, match="contains the bundle of another study"):
        export_study(plan_of(inputs), tmp_path / "out", draw=draw_noise)
    with pytest.raises(RunError, match="is a file; give a folder"):
        export_study(plan_of(inputs), inputs / "plan.toml", draw=draw_noise)


def _save_again(folder: Path) -> None:
    motion = load_motion(folder / "localnet-garden.npz")
    save_motion(replace(motion, betas=motion.betas + 1), folder / "globalnet-garden.npz")


def _lengthen(folder: Path) -> None:
    save_motion(smooth_motion_example(FRAMES + 5, seed=5), folder / "globalnet-garden.npz")


@pytest.mark.parametrize(
    ("spoil", "settings", "words"),
    [
        (
            lambda folder: (folder / "globalnet-garden.npz").unlink(),
            *("", "The motion of 'globalnet' for clip 'garden' was not found"),
        ),
        (
            lambda folder: (folder / "garden.wav").unlink(),
            *("", "The speech of clip 'garden' was not found"),
        ),
        (_lengthen, "", "The files of clip 'garden' have different lengths"),
        (
            lambda folder: shutil.copy(
                folder / "localnet-garden.npz", folder / "globalnet-garden.npz"
            ),
            *("", "'localnet' and 'globalnet' have the same motion file for clip 'garden'"),
        ),
        (_save_again, "", "'localnet' and 'globalnet' have identical motion in clip 'garden'"),
        (
            lambda folder: write_wav(folder / "garden.wav", np.zeros(8_000, np.float32)),
            *("", "is silent"),
        ),
        (bool, "length_s = 3", "less than the video length of 3 s"),
    ],
)
def test_bad_input_gives_one_sentence_and_no_bundle(inputs, tmp_path, spoil, settings, words):
    plan = plan_of(inputs, settings)
    spoil(inputs)
    with pytest.raises(ValueError) as caught:
        export_study(plan, tmp_path / "out", draw=draw_noise)
    assert words in str(caught.value) and "\n" not in str(caught.value)
    assert not (tmp_path / "out" / "participant_bundle" / "index.html").exists()


def test_length_body_face_and_place_are_the_same_for_every_system(inputs, tmp_path):
    """A longer clip of a person of another build, far from the middle and with a moving face,
    looks no different and is cut to the length asked for."""
    motion = smooth_motion_example(FRAMES + 5, seed=5)
    other = replace(motion, betas=motion.betas + 2, trans=motion.trans + np.float32([3, 1, -2]),
                    expression_basis="flame100")  # fmt: skip
    save_motion(other, inputs / "globalnet-garden.npz")
    seen = {}

    def look(jobs, **rest) -> None:
        seen.update(jobs)
        draw_noise(jobs, **rest)

    length = f"length_s = {FRAMES / 30}"
    study = export_study(plan_of(inputs, length, HERE[1:]), tmp_path / "out", draw=look)
    assert {len(media.read_mp4(path).tracks[0].sample_sizes) for path in study.media.iterdir()} == {
        FRAMES
    }
    first, second = (seen[name, "front"] for name in TWO)
    assert first.stage == second.stage and first.settings == second.settings
    for job in (first, second):
        assert not job.motion.betas.any() and not job.motion.expressions.any()
        assert not job.motion.poses[:, 66:75].any()  # jaw and eyes
        assert np.abs(job.motion.trans[:, [0, 2]].mean(axis=0)).max() < 1e-5
    moving = plan_of(inputs, f'{length}\nface = "moving"')
    with pytest.raises(RunError, match=r"different face models \(arkit52 and flame100\)"):
        export_study(moving, tmp_path / "b", draw=draw_noise)


@pytest.mark.gl
def test_the_real_renderer_makes_a_blind_study(weights, tmp_path):
    """Generated motion beside a file, drawn by worker processes; systems hear the excerpt."""
    write_inputs(tmp_path, ["recorded"], ["one"], frames=24)
    text = write_plan(tmp_path, ["recorded"], ["one"], "length_s = 0.5").read_text()
    text += '[[systems]]\nname = "globaldiff/local"\nsteps = 1\n'
    (tmp_path / "plan.toml").write_text(text)
    argv = ["study", "export", str(tmp_path / "plan.toml"), "--out", str(tmp_path / "out")]
    assert main([*argv, "--weights", str(weights)]) == 0
    study = ExportFolders(tmp_path / "out")
    assert find_leaks(tmp_path / "out") == []
    assert len({file_sha256(path) for path in study.media.iterdir()}) == 2
    provenance = json.loads((study.private / "provenance.json").read_text())
    assert provenance["weights"].keys() == {"globaldiff/local"}
