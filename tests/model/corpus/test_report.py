"""The report measures what it says: closed forms, planted differences, and a page from a corpus."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from model.corpus import report
from model.corpus.build import build_corpus
from model.corpus.judging import (
    alignment_scores,
    area_under_curve,
    ridge_weights,
    separability,
    sound_features,
)
from model.corpus.layout import wav_bytes
from model.corpus.rig import open_body_rig
from model.corpus.statistics import (
    PosedClip,
    clip_statistics,
    derivative,
    turning_deg_s,
    window_features,
)
from model.timing import FPS


def test_derivatives_of_a_cubic_are_known() -> None:
    time = np.arange(60) / FPS
    place = np.stack([2.0 * time, 0 * time, time**3], axis=1)
    np.testing.assert_allclose(derivative(place, 3), 6.0, rtol=1e-6)
    straight = place * [1.0, 1.0, 0.0]
    np.testing.assert_allclose(derivative(straight, 1), 2.0, rtol=1e-9)


def test_turning_is_in_degrees_per_second() -> None:
    angles = np.radians(np.arange(31))  # one degree a frame
    rotmat = Rotation.from_rotvec(angles[:, None] * [0.0, 1.0, 0.0]).as_matrix()[:, None]
    np.testing.assert_allclose(turning_deg_s(rotmat), 30.0, rtol=1e-6)


def standing(seconds: float, shake_hz: float) -> PosedClip:
    """The rest pose with a right fingertip that moves by 1 cm at one frequency."""
    rig = open_body_rig()
    time = np.arange(int(seconds * FPS)) / FPS
    rest = np.tile(np.eye(3), (len(time), 55, 1, 1))
    places = np.tile(rig.rest_joints, (len(time), 1, 1))
    shake = 0.01 * np.sin(2 * np.pi * shake_hz * time)
    places[:, 21, 1] += shake
    places[:, 20, 1] += 0.5 * shake
    tip = places[:, 45] + shake[:, None]
    return PosedClip(rest, rest, places, tip)


def test_a_shaking_tip_has_its_power_where_it_shakes() -> None:
    key = "fingertip velocity power above 5 Hz, share"
    slow, fast = (clip_statistics(standing(20.0, hz)) for hz in (2.0, 8.0))
    assert slow[key] < 0.01
    assert fast[key] > 0.99
    assert fast["right fingertip jerk, m/s^3"] > 10 * slow["right fingertip jerk, m/s^3"]
    assert abs(slow["right wrist speed, m/s"] - 4 * 0.01 * 2.0) < 0.005  # 4 amplitudes a period
    assert slow["left-right speed correlation"] > 0.99
    assert slow["planted ankle slip, cm/s"] == 0
    assert slow["knee bend, median, deg"] == 0


def test_windows_overlap_by_half() -> None:
    assert len(window_features(standing(20.0, 1.0), window_s=4.0)) == 8


def test_area_under_the_curve() -> None:
    low, high = np.array([1.0, 2.0, 3.0]), np.array([4.0, 5.0])
    assert area_under_curve(low, high) == 1.0
    assert area_under_curve(high, low) == 0.0
    assert area_under_curve(low, low) == 0.5
    assert area_under_curve(np.array([1.0, 3.0]), np.array([2.0])) == 0.5


def test_separability_finds_a_planted_difference_and_no_other() -> None:
    rng = np.random.default_rng(0)

    def people(shift: float) -> np.ndarray:
        return rng.normal(size=(400, 6)) + shift * np.eye(6)[0]

    assert separability(people(0), people(2.0), people(0), people(2.0)) > 0.88
    assert 0.4 < separability(people(0), people(0), people(0), people(0)) < 0.6


def test_speech_that_drives_a_motion_is_told_from_shifted_speech(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    features, targets = [], []
    for k in range(4):
        loudness = np.repeat(rng.uniform(0, 1, 40), 12)  # 0.4 s each, 16 s
        samples = 0.2 * np.repeat(loudness, 533) * rng.normal(size=480 * 533)
        path = tmp_path / f"{k}.wav"
        path.write_bytes(wav_bytes(np.clip(samples, -1, 1)))
        features.append(sound_features(path, 480))
        targets.append((loudness - loudness.mean()) / loudness.std())
    assert features[0].shape[0] == 480
    weights = ridge_weights(features[:2], targets[:2])
    right, shifted = alignment_scores(weights, features[2:], targets[2:], 7.0)
    assert right.min() > 0.8
    assert np.abs(shifted).max() < 0.5


def test_a_folder_without_clips_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert report.main(["--data", str(tmp_path), "--out", str(tmp_path / "page.md")]) == 1
    assert "holds no clips in BEAT2's layout" in capsys.readouterr().err
    assert not (tmp_path / "page.md").exists()


def test_the_page_names_every_speaker_and_shows_pictures(flite: None, tmp_path: Path) -> None:
    data = tmp_path / "data"
    build_corpus(data, 8 / 3600, seed=1, workers=1)
    out = tmp_path / "docs" / "corpus.md"
    assert report.main(["--data", str(data), "--real", str(data), "--out", str(out)]) == 0
    page = out.read_text()
    assert "| figure | **1_anna_0_0_0** | anna |" in page
    assert page.count("Too few clips to say.") == 2
    for name in ("corpus_gestures.png", "corpus_speakers.png"):
        assert f"(figures/{name})" in page
        assert (out.parent / "figures" / name).read_bytes().startswith(b"\x89PNG")
