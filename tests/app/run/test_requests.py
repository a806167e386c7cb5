"""What is shown of a motion, and what is said of a file as soon as it has been uploaded."""

import io
import tarfile
import zipfile
from pathlib import Path

import numpy as np
import pytest

from app.errors import RunError
from app.run.bodies import PointTracker
from app.run.display import Display, check_display
from app.run.examples import CLEAN
from app.run.upload_check import Upload, file_kind, rejection_reason
from app.run.videos.videos import make_overlays, with_exaggerated_tremor
from conventions.joints import JOINT_INDEX
from model.motion.motion import Motion
from model.speech.audio import write_wav
from renderer.body.body import load_body
from tests.app.fakes import made_motion
from tests.model.made import made_waveform

BODY = load_body()
TIP = PointTracker()
MAX_S = 2.0


def trail_of(motion: Motion, display: Display):
    marks = make_overlays(motion, display, TIP, BODY)
    assert marks is not None and marks.trail is not None
    return marks.trail


def heat_of(motion: Motion, display: Display):
    marks = make_overlays(motion, display, TIP, BODY)
    assert marks is not None and marks.heat is not None
    return marks.heat


def test_a_plain_display_marks_nothing():
    motion = made_motion(40)
    assert Display().is_default
    assert make_overlays(motion, Display(), TIP, BODY) is None
    assert with_exaggerated_tremor(motion, Display()) is motion


def test_the_trail_has_dots_where_the_point_jerks():
    jump = made_motion(60, 0.0)
    jump.poses[30:, 3 * JOINT_INDEX["right_elbow"] + 1] = 0.3
    trail = trail_of(jump, Display(has_trail=True))
    frames = np.flatnonzero(trail.is_spike)
    assert len(frames) and 27 <= frames.min() <= 30 <= frames.max() <= 32
    assert trail.points.shape == (
        60,
        3,
    ) and trail.normalized_speeds.shape == trail.is_spike.shape == (60,)
    assert trail.close_up_view == "right_hand"
    assert trail_of(made_motion(60, 0.5), Display(has_trail=True)).is_spike.any()
    for still in (made_motion(60, 0.0), made_motion(2)):  # a clip too short for jerk has none
        assert not trail_of(still, Display(has_trail=True)).is_spike.any()
    marks = make_overlays(jump, Display(has_trail=True), TIP, BODY)
    assert marks is not None and marks.heat is None and not marks.notice


def test_colours_follow_the_jerk_of_each_joint_on_a_fixed_scale():
    heat = heat_of(made_motion(60, 0.5), Display(coloring="jerk"))
    shares = heat.normalized_jerk
    assert shares.shape == (60, 55) and shares.min() >= 0 and shares.max() <= 1
    assert shares[:, JOINT_INDEX["right_wrist"]].mean() > 0.5
    assert shares[:, JOINT_INDEX["left_wrist"]].max() < 1e-3
    assert "500 m/s³" in heat.legend
    wider = heat_of(made_motion(60, 0.5), Display(coloring="jerk", max_jerk_m_s3=2000.0))
    assert "2000" in wider.legend
    assert np.allclose(wider.normalized_jerk[shares < 1], shares[shares < 1] / 4)
    assert not heat_of(made_motion(2), Display(coloring="jerk")).normalized_jerk.any()


def test_exaggerated_motion_says_so_and_its_jerk_is_that_of_the_motion():
    motion = made_motion(60, 0.002)
    large, plain = Display(20, True, "jerk"), Display(1, True, "jerk")
    marks = make_overlays(motion, large, TIP, BODY)
    assert marks is not None
    assert marks.notice.startswith("EXAGGERATED x20") and marks.close_up_notice == "x20"
    drawn, kept = trail_of(motion, large), trail_of(motion, plain)
    assert np.array_equal(drawn.is_spike, kept.is_spike)
    assert np.array_equal(
        heat_of(motion, large).normalized_jerk, heat_of(motion, plain).normalized_jerk
    )
    ratio = np.ptp(drawn.points, axis=0).max() / np.ptp(kept.points, axis=0).max()
    assert 8 < ratio < 30


def test_factor_cut_off_and_length_of_a_trail_are_what_was_asked_for():
    motion = made_motion(60, 0.02)
    display = Display(2.26, True, cutoff_hz=7.0, trail_frames=12)
    marks = make_overlays(motion, display, TIP, BODY)
    assert marks is not None and marks.trail is not None
    assert marks.notice == "EXAGGERATED x2.3 above 7 Hz" and marks.trail.length_frames == 12
    lower = with_exaggerated_tremor(motion, Display(2.26, cutoff_hz=3.0))
    assert np.abs(with_exaggerated_tremor(motion, display).poses - lower.poses).max() > 0.005


def test_what_cannot_be_shown_is_refused() -> None:
    for display, words in [
        (Display(exaggeration=21), "factor must be from 1 to 20; got 21"),
        (Display(exaggeration=0.9), "factor must be from 1 to 20; got 0.9"),
        (Display(exaggeration=float("nan")), "factor must be from 1 to 20; got nan"),
        (Display(cutoff_hz=2), "must be from 3 to 8 Hz; got 2"),
        (Display(trail_frames=91), "5 to 90 frames long; got 91"),
        (Display(max_jerk_m_s3=0), "must be from 50 to 2000 m/s³; got 0"),
        (Display(coloring="rainbow"), "no colouring 'rainbow'"),  # type: ignore[arg-type]
    ]:
        with pytest.raises(RunError, match=words):
            check_display(display)
        for bound in (Display(1), Display(20), Display(cutoff_hz=3), Display(cutoff_hz=8)):
            check_display(bound)


def wav(path: Path, seconds: float) -> Path:
    write_wav(path, made_waveform(round(16_000 * seconds)))
    return path


def test_what_can_be_used_is_not_refused(tmp_path: Path) -> None:
    text = tmp_path / "said.txt"
    text.write_text("Hello, world.")
    asks, packed = tmp_path / "asks.npz", tmp_path / "sounds.zip"  # the form can say which motion
    np.savez(asks, **{f"{name}/poses": np.zeros((9, 165)) for name in "ab"})
    zipfile.ZipFile(packed, "w").close()
    for kind, files in (
        ("speech", [wav(tmp_path / "a.wav", 1.0)]),
        ("reference", [CLEAN]),
        ("motion", [CLEAN]),
        ("motion", []),
        ("files", [asks, packed, CLEAN, text]),
        ("transcript", [CLEAN.with_suffix(".TextGrid")]),
        ("transcript", [text]),
    ):
        assert rejection_reason(Upload(kind, files, MAX_S)) == "", (kind, files)
    assert rejection_reason(Upload("speech", [wav(tmp_path / "b.wav", 3.0)], MAX_S)).endswith(".")
    text.write_text("?")
    assert rejection_reason(Upload("transcript", [text], MAX_S)) == "said.txt holds no words."


def test_the_first_wrong_file_is_named(tmp_path: Path) -> None:
    for kind in ["speech", "reference", "motion", "transcript"]:
        wrong = [tmp_path / f"{name}.npz" for name in ("first", "second")]
        for path in wrong:
            path.write_bytes(b"\x00" * 64)
        sentence = rejection_reason(Upload(kind, wrong, MAX_S))
        assert "first" in sentence and "second" not in sentence


@pytest.mark.parametrize("ending", [".zip", ".tar", ".tar.gz", ".tgz"])
def test_an_archive_is_what_is_in_it_however_it_is_called(tmp_path, ending):
    for name, inside, kind in (
        ("cospeech_audio", ("set/a.npz", "set/b.bvh"), "motions"),
        ("motions.npz", ("a.ogg", "b.wav"), "sounds"),
        ("sounds", ("a.wav", "a.npz"), "motions"),
        ("empty", (), "motions"),
    ):
        path = tmp_path / f"{name}{ending}"
        if ending == ".zip":
            with zipfile.ZipFile(path, "w") as archive:
                for each in inside:
                    archive.writestr(each, b"x" * 1000)
        else:
            with tarfile.open(path, "w" if ending == ".tar" else "w:gz") as archive:
                for each in inside:
                    member = tarfile.TarInfo(each)
                    member.size = 1000
                    archive.addfile(member, io.BytesIO(b"x" * 1000))
        assert file_kind(path) == kind, path.name
    damaged = tmp_path / f"damaged{ending}"
    damaged.write_bytes(b"\x1f\x8bno archive")
    assert file_kind(damaged) == "motions"


def test_headers_of_a_tar_that_cannot_be_read_are_no_fault_of_the_program(tmp_path):
    endless = tarfile.TarInfo("././@LongLink")
    endless.type = tarfile.GNUTYPE_LONGNAME
    wild = bytearray(tarfile.TarInfo("a.wav").tobuf(tarfile.GNU_FORMAT))
    wild[124:136] = b"\x80" + b"\xff" * 11
    for name, content in (("deep", endless.tobuf(tarfile.GNU_FORMAT) * 3_000), ("size", wild)):
        path = tmp_path / f"{name}.tar"
        path.write_bytes(content)
        assert file_kind(path) == "motions"
