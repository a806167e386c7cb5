import numpy as np
import pytest

from conventions.joints import JOINT_INDEX
from model.evaluation.matching import PIECE_FRAMES
from model.evaluation.speakers import SpeakerJudge, discriminant, judge_of, manner_numbers
from model.motion.motion import Motion, save_motion
from tests.helpers import smooth_motion_example
from tests.model.made import make_data_folder


def moved(seconds: float, seed: int, size: float) -> Motion:
    """Arms that swing ``size`` times as far."""
    motion = smooth_motion_example(round(30 * seconds), seed)
    poses = motion.poses.reshape(motion.num_frames, -1, 3).copy()
    arms = [
        JOINT_INDEX[f"{side}_{part}"]
        for side in ("left", "right")
        for part in ("shoulder", "elbow")
    ]
    mean = poses[:, arms].mean(0)
    poses[:, arms] = mean + size * (poses[:, arms] - mean)
    return Motion(**{**vars(motion), "poses": poses.reshape(motion.poses.shape)})


def test_the_discriminant_is_the_gaussian_one_of_equal_covariances():
    rng = np.random.default_rng(0)
    mix = rng.standard_normal((3, 3))
    centres = {"ann": np.zeros(3), "bob": np.array([1.0, 0.5, 0.0]), "eve": np.array([0.0, 2, 1])}
    own = {who: at + rng.standard_normal((4000, 3)) @ mix for who, at in centres.items()}
    judge = discriminant(own)
    asked = rng.standard_normal((200, 3)) @ mix + 0.5
    covariance = mix.T @ mix
    off = [asked - at for at in centres.values()]
    wanted = np.stack(
        [-0.5 * np.einsum("ni,ij,nj->n", x, np.linalg.inv(covariance), x) for x in off], axis=1
    )
    told = asked @ judge.weights.T + judge.bias
    agree = told.argmax(1) == wanted.argmax(1)
    assert agree.mean() > 0.9  # shrinkage and chance leave a little


def test_a_lively_and_a_calm_speaker_are_told_and_short_motion_is_not():
    pieces = {
        who: np.concatenate([manner_numbers(moved(10, 10 * seed + k, size)) for seed in range(8)])
        for k, (who, size) in enumerate({"calm": 0.4, "lively": 1.0}.items())
    }
    judge = discriminant(pieces)
    assert judge.share_right(moved(30, 99, 0.4), "calm") == 1.0
    assert judge.share_right(moved(30, 99, 1.0), "lively") == 1.0
    assert judge.share_right(moved(30, 99, 1.0), "calm") == 0.0
    assert judge.share_right(moved(30, 99, 1.0), "nobody") is None
    assert judge.share_right(moved(9.9, 99, 1.0), "calm") is None
    assert judge.measures([moved(10, 98, 0.4), moved(10, 97, 1.0)], "calm") == {"speaker_told": 0.5}
    assert judge.measures([], "calm") == {}


def test_it_learns_from_the_training_split_alone(tmp_path):
    folder = make_data_folder(tmp_path / "data", seconds=12)
    judge = judge_of(folder, ["ann", "bob", "eve"])
    assert isinstance(judge, SpeakerJudge) and judge.speakers == ("ann", "bob")
    path = folder / "smplxflame_30" / "1_ann_0_2_2.npz"  # of the validation split
    save_motion(moved(12, 5, 3.0), path)
    again = judge_of(folder, ["ann", "bob", "eve"])
    np.testing.assert_array_equal(again.weights, judge.weights)
    save_motion(moved(12, 5, 3.0), folder / "smplxflame_30" / "1_ann_0_0_0.npz")
    other = judge_of(folder, ["ann", "bob", "eve"])
    assert not np.allclose(other.weights, judge.weights)


def test_speakers_without_recordings_long_enough_are_left_out(tmp_path):
    folder = make_data_folder(tmp_path / "data", seconds=4)
    assert judge_of(folder, ["ann", "bob"]) is None


@pytest.mark.parametrize(("frames", "count"), [(299, 0), (300, 1), (599, 1), (600, 2)])
def test_a_rest_of_less_than_a_piece_is_left_out(frames, count):
    assert len(manner_numbers(smooth_motion_example(frames, 1))) == count == frames // PIECE_FRAMES
