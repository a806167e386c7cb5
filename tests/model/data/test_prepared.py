"""Training data: copies in time with their speech, mirrored windows, and real BEAT2 folders."""

import logging
import shutil
from dataclasses import replace

import numpy as np
import pytest
import torch

from model.data.prepared import prepare
from model.data.recordings import DataError, augmented_copy, encode_clip
from model.motion.kinematics import mirror_face_units, mirror_poses, mirror_transl
from model.motion.motion import save_motion
from model.speech.audio import Speech, write_wav
from model.speech.features import NUM_MELS, MelEncoder
from model.storage.files import WriteError
from tests.helpers import beat2_folder, smooth_motion_example
from tests.model.made import made_waveform, make_data_folder


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return make_data_folder(tmp_path_factory.mktemp("data") / "corpus")


@pytest.fixture(scope="module")
def data(folder):
    return prepare(folder, folder.parent / "prepared", MelEncoder(), augmented_copies=2)


def test_training_recordings_alone_have_copies(data):
    kinds = [(clip.name, clip.split, clip.copy) for clip in data.clips]
    assert kinds == [
        *(("1_ann_0_0_0", "train", copy) for copy in range(3)),
        ("1_ann_0_2_2", "val", 0),
        *(("2_bob_0_1_1", "train", copy) for copy in range(3)),
        ("3_eve_0_3_3", "test", 0),
    ]
    stops = [clip.stop for clip in data.clips]
    assert [clip.start for clip in data.clips] == [0, *stops[:-1]]
    for array in (data.poses, data.transl, data.expression, data.speech):
        assert len(array) == stops[-1]
    for clip in data.clips:
        assert 120 / 1.1 - 1 < clip.num_frames < 120 / 0.9 + 1
        assert clip.copy > 0 or clip.num_frames == 120


def test_the_recording_itself_is_stored_as_without_copies(folder, data, tmp_path):
    clean = prepare(folder, tmp_path / "clean", MelEncoder())
    originals = [clip for clip in data.clips if clip.copy == 0]
    for clip, same in zip(originals, clean.clips, strict=True):
        for name in ("poses", "transl", "expression", "speech"):
            rows = getattr(data, name)[clip.start : clip.stop]
            np.testing.assert_array_equal(rows, getattr(clean, name)[same.start : same.stop])


def test_copies_repeat_and_differ(folder, data, tmp_path):
    again = prepare(folder, tmp_path / "again", MelEncoder(), augmented_copies=2)
    assert again.clips == data.clips
    np.testing.assert_array_equal(again.speech, data.speech)
    first, second = (data.speech[c.start : c.start + 100] for c in data.clips[1:3])
    assert np.abs(first.astype(float) - second).mean() > 0.05


def test_a_cache_is_used_again_and_only_for_what_it_was_made_for(folder, data, tmp_path):
    class Never(MelEncoder):
        def encode(self, waveform, num_frames):
            raise AssertionError("encoded again")

    again = prepare(folder, folder.parent / "prepared", Never(), augmented_copies=2)
    assert again.clips == data.clips
    prepare(folder, tmp_path / "cache", MelEncoder())
    with pytest.raises(DataError, match="another version or with another encoder"):
        prepare(folder, tmp_path / "cache", Never(), min_frames=61)


def test_other_recordings_of_the_same_names_get_arrays_of_their_own(tmp_path):
    """Two corpora made with different seeds name their clips alike."""
    first, second = (make_data_folder(tmp_path / name) for name in ("one", "two"))
    name = "1_ann_0_0_0"
    save_motion(smooth_motion_example(120, 77), second / "smplxflame_30" / f"{name}.npz")
    a, b = (prepare(folder, tmp_path / "prepared", MelEncoder()) for folder in (first, second))
    assert [clip.name for clip in a.clips] == [clip.name for clip in b.clips]
    assert a.folder != b.folder and a.folder.parent == b.folder.parent
    assert np.abs(a.poses[:120] - b.poses[:120]).max() > 0.01
    moved = shutil.copytree(first, tmp_path / "elsewhere")
    assert prepare(moved, tmp_path / "prepared", MelEncoder()).folder == a.folder
    write_wav(moved / "wave16k" / f"{name}.wav", made_waveform(64_000, seed=9))
    assert prepare(moved, tmp_path / "prepared", MelEncoder()).folder != a.folder


def test_a_full_disk_leaves_no_cache_that_looks_whole(folder, tmp_path, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("model.data.prepared._append", full)
    with pytest.raises(WriteError, match="the disk is full"):
        prepare(folder, tmp_path / "cache", MelEncoder())
    (cache,) = tmp_path.iterdir()
    assert not list(cache.iterdir())


@pytest.mark.parametrize("copy", range(1, 7))
def test_motion_stays_in_time_with_its_speech(copy):
    """A loud syllable and a jump of the body fall together at any speed."""
    num_frames, event = 300, 200
    motion = smooth_motion_example(num_frames)
    height = np.exp(-0.5 * ((np.arange(num_frames) - event) / 3) ** 2)
    motion = replace(motion, trans=np.stack([0 * height, height, 0 * height], 1).astype(np.float32))
    samples = np.arange(160_000) / 16_000 * 30
    loudness = 0.02 + np.exp(-0.5 * ((samples - event - 0.5) / 3) ** 2)
    waveform = (made_waveform(160_000) * loudness).astype(np.float32)
    copied = augmented_copy(motion, Speech(waveform, "0" * 64), "1_ann_0_1_1", copy)
    moved, features = encode_clip(*copied, MelEncoder())
    jump = int(np.argmax(moved.trans[:, 1]))
    loudest = int(np.argmax(np.convolve(features[:, NUM_MELS], np.ones(5), "same")))
    assert abs(jump - loudest) <= 2
    assert len(features) == moved.num_frames
    assert 180 < jump < 224


def test_mirrored_windows_are_the_same_windows_in_a_mirror(data):
    clips = data.of_split("train")

    def draw(mirror: float):
        return data.window_batch(clips, 60, 64, np.random.default_rng(5), mirror=mirror)

    plain, half, every = draw(0.0), draw(0.5), draw(1.0)
    assert every.mirrored.all() and not plain.mirrored.any()
    assert 16 < int(half.mirrored.sum()) < 48
    for batch in (half, every):
        np.testing.assert_array_equal(batch.frames, plain.frames)
        rows = batch.mirrored
        for name, mirror in (
            ("poses", mirror_poses),
            ("transl", mirror_transl),
            ("expression", mirror_face_units),
        ):
            seen, before = getattr(batch, name), getattr(plain, name)
            torch.testing.assert_close(seen[rows], mirror(before)[rows], rtol=0, atol=0)
            torch.testing.assert_close(seen[~rows], before[~rows], rtol=0, atol=0)
        assert torch.equal(batch.speech, plain.speech)
        assert torch.equal(batch.speaker, plain.speaker)
    with pytest.raises(ValueError, match="mirrored already"):
        every.mirror(every.mirrored)


def test_windows_longer_than_all_clips_are_refused(data):
    with pytest.raises(DataError, match="None of the 6 clips has 600 frames"):
        data.window_batch(data.of_split("train"), 600, 2, np.random.default_rng(0))


@pytest.mark.parametrize(("seconds", "is_used"), [(5.5, True), (4.5, False)])
def test_motion_and_sound_that_hardly_belong_together_are_named(seconds, is_used, tmp_path, caplog):
    folder = make_data_folder(tmp_path / "long", seconds=10.0)
    write_wav(folder / "wave16k" / "2_bob_0_1_1.wav", made_waveform(round(16_000 * seconds)))
    with caplog.at_level(logging.WARNING):
        data = prepare(folder, tmp_path / "cache", MelEncoder())
    assert ("2_bob_0_1_1" in [clip.name for clip in data.clips]) == is_used
    assert ("motion lasts 10.0 s and its sound 4.5 s" in caplog.text) != is_used


def test_real_beat2_clips_load_and_bad_ones_are_named(tmp_path, caplog):
    root = tmp_path / "beat2"
    shutil.copytree(beat2_folder(), root)
    for path in (root, *root.rglob("*")):
        path.chmod(0o755)
    names = sorted(path.stem for path in (root / "smplxflame_30").glob("*.npz"))
    (root / "train_test_split.csv").write_text(
        "id,type\n" + "".join(f"{name},train\n" for name in (*names, "2_scott_0_9_9"))
    )
    path = root / "smplxflame_30" / f"{names[0]}.npz"
    path.write_bytes(path.read_bytes()[:10_000])
    with caplog.at_level(logging.WARNING):
        data = prepare(root, tmp_path / "cache", MelEncoder(), augmented_copies=1)
    assert f"Skipped {names[0]}: " in caplog.text
    assert "Skipped 2_scott_0_9_9: " in caplog.text and "2 of 3 clips were skipped" in caplog.text
    assert [(clip.name, clip.copy) for clip in data.clips] == [(names[1], 0), (names[1], 1)]
    assert data.speakers == {2: "scott"}
    assert data.clips[0].num_frames > 1500
    assert not data.expression.any()  # FLAME coefficients are no face units
    batch = data.window_batch(data.clips, 60, 4, np.random.default_rng(0), mirror=0.5)
    assert batch.poses.shape == (4, 60, 165) and torch.isfinite(batch.speech).all()
