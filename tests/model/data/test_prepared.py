"""Training data: copies in time with their speech, and real BEAT2 folders."""

import logging
import shutil
from dataclasses import replace

import numpy as np
import pytest

from model.data.prepared import prepare
from model.data.recordings import DataError, augmented_copy, cut_and_encode_speech, read_split
from model.motion.motion import save_motion
from model.speech.audio import Speech, write_wav
from model.speech.features import NUM_MELS, MelEncoder
from model.storage.files import WriteError
from tests.helpers import beat2_folder, smooth_motion_example
from tests.model.made import made_waveform, make_data_folder


@pytest.fixture(scope="module")
def copies(tmp_path_factory):
    return tmp_path_factory.mktemp("data")


@pytest.fixture(scope="module")
def data(data_folder, copies):
    return prepare(data_folder, copies, MelEncoder(), augmented_copies=2)


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
    for array in (data.poses, data.transl, data.arkit_weights, data.speech):
        assert len(array) == stops[-1]
    for clip in data.clips:
        assert 120 / 1.1 - 1 < clip.num_frames < 120 / 0.9 + 1
        assert clip.copy > 0 or clip.num_frames == 120


def test_a_full_disk_leaves_no_cache_that_looks_whole(data_folder, tmp_path, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("model.data.prepared.arkit_weights_or_zeros", full)
    with pytest.raises(WriteError, match="the disk is full"):
        prepare(data_folder, tmp_path / "cache", MelEncoder())
    (cache,) = tmp_path.iterdir()
    assert not list(cache.iterdir())


@pytest.mark.parametrize("copy", [1, 2, 5])
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
    moved, features = cut_and_encode_speech(*copied, MelEncoder())
    jump = int(np.argmax(moved.trans[:, 1]))
    loudest = int(np.argmax(np.convolve(features[:, NUM_MELS], np.ones(5), "same")))
    assert abs(jump - loudest) <= 2
    assert len(features) == moved.num_frames
    assert 180 < jump < 224


def test_clips_shorter_than_a_window_are_told(data):
    with pytest.raises(DataError, match="None of the 6 clips is as long as a window"):
        data.draw_windows(data.clips_of_split("train"), 600, 2, np.random.default_rng(0))


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
    assert data.speaker_names == {2: "scott"}
    assert data.clips[0].num_frames > 1500
    assert not data.arkit_weights.any()  # FLAME coefficients are not face units


def test_copies_repeat_and_differ_and_the_recording_itself_is_as_without_them(
    data_folder, data, tmp_path
):
    again = prepare(data_folder, tmp_path / "again", MelEncoder(), augmented_copies=2)
    assert again.clips == data.clips
    np.testing.assert_array_equal(again.speech, data.speech)
    first, second = (data.speech[c.start : c.start + 100] for c in data.clips[1:3])
    assert np.abs(first.astype(float) - second).mean() > 0.05
    clean = prepare(data_folder, tmp_path / "clean", MelEncoder())
    originals = [clip for clip in data.clips if clip.copy == 0]
    for clip, same in zip(originals, clean.clips, strict=True):
        for name in ("poses", "transl", "arkit_weights", "speech"):
            rows = getattr(data, name)[clip.start : clip.stop]
            np.testing.assert_array_equal(rows, getattr(clean, name)[same.start : same.stop])


def test_arrays_are_used_again_and_only_for_what_they_were_made_for(
    data_folder, data, copies, tmp_path
):
    """Two corpora made with different seeds name their clips alike."""

    class Never(MelEncoder):
        def encode(self, waveform, num_frames):
            raise AssertionError("encoded again")

    class Other(Never):
        name = "other"

    again = prepare(data_folder, copies, Never(), augmented_copies=2)
    assert again.clips == data.clips and again.cache_folder == data.cache_folder
    first = prepare(data_folder, tmp_path / "prepared", MelEncoder())
    with pytest.raises(DataError, match="another version of this program or with another encoder"):
        prepare(data_folder, tmp_path / "prepared", Other())
    moved, name = shutil.copytree(data_folder, tmp_path / "elsewhere"), "1_ann_0_0_0"
    assert prepare(moved, tmp_path / "prepared", Never()).cache_folder == first.cache_folder
    save_motion(smooth_motion_example(120, 77), moved / "smplxflame_30" / f"{name}.npz")
    other = prepare(moved, tmp_path / "prepared", MelEncoder())
    assert [clip.name for clip in other.clips] == [clip.name for clip in first.clips]
    assert np.abs(first.poses[:120] - other.poses[:120]).max() > 0.01
    write_wav(moved / "wave16k" / f"{name}.wav", made_waveform(64_000, seed=9))
    third = prepare(moved, tmp_path / "prepared", MelEncoder())
    assert len({first.cache_folder, other.cache_folder, third.cache_folder}) == 3
    assert first.cache_folder.parent == other.cache_folder.parent == third.cache_folder.parent


def test_bad_clips_are_named_skipped_and_counted_and_others_cut_to_the_shorter(
    data_folder, tmp_path, caplog
):
    folder = shutil.copytree(data_folder, tmp_path / "data")
    (folder / "smplxflame_30" / "1_ann_0_0_0.npz").write_bytes(b"no npz")
    (folder / "wave16k" / "3_eve_0_3_3.wav").write_bytes(b"")
    write_wav(folder / "wave16k" / "2_bob_0_1_1.wav", made_waveform(16_000 * 3))
    with caplog.at_level(logging.WARNING):
        data = prepare(folder, tmp_path / "cache", MelEncoder())
    frames = {clip.name: clip.num_frames for clip in data.clips}
    assert frames == {"1_ann_0_2_2": 120, "2_bob_0_1_1": 90}
    assert len(data.poses) == len(data.speech) == len(data.arkit_weights) == 210
    assert "1_ann_0_0_0" in caplog.text and "2 of 4 clips were skipped" in caplog.text
    with pytest.raises(DataError, match="lists no usable test clip"):
        data.clips_of_split("test")


def test_motion_and_sound_that_hardly_belong_together_are_named(tmp_path, caplog):
    folder = make_data_folder(tmp_path / "long", seconds=10.0)
    for name, seconds in (("2_bob_0_1_1", 5.5), ("1_ann_0_0_0", 4.5)):
        write_wav(folder / "wave16k" / f"{name}.wav", made_waveform(round(16_000 * seconds)))
    with caplog.at_level(logging.WARNING):
        data = prepare(folder, tmp_path / "cache", MelEncoder())
    assert [clip.name for clip in data.clips_of_split("train")] == ["2_bob_0_1_1"]
    assert "motion lasts 10.0 s and its sound 4.5 s" in caplog.text


def test_folders_of_another_layout_are_refused(tmp_path):
    with pytest.raises(DataError, match=r"train_test_split\.csv is missing"):
        read_split(tmp_path)
    (tmp_path / "train_test_split.csv").write_text("a,b\n1,2\n")
    with pytest.raises(DataError, match="columns id and type"):
        read_split(tmp_path)
