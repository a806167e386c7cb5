"""Rotations and the root as channels of a network."""

import pytest
import torch

from conventions.joints import JOINT_INDEX
from model.motion import packing
from model.motion.packing import ROTATION_DIM, Normaliser, pack, root_positions


def test_layout_is_joint_major_row6d_then_root_and_regions_cover_it_once():
    rot6d = torch.arange(2 * 55 * 6, dtype=torch.float32).reshape(1, 2, 55, 6)
    transl = torch.tensor([[[1.0, 2.0, 3.0], [1.1, 2.5, 2.7]]])
    vector = pack(rot6d, transl)
    wrist = JOINT_INDEX["right_wrist"]
    torch.testing.assert_close(vector[0, 1, 6 * wrist : 6 * wrist + 6], rot6d[0, 1, wrist])
    # 0.1 m and -0.3 m in one frame of 1/30 s; the height stays a position
    torch.testing.assert_close(vector[0, 1, 330:], torch.tensor([3.0, 2.5, -9.0]))
    torch.testing.assert_close(vector[0, 0, 330:], torch.tensor([3.0, 2.0, -9.0]))
    one_frame = pack(rot6d[0, :1], transl[0, :1])  # has no velocity
    torch.testing.assert_close(one_frame[0, 330:], torch.tensor([0.0, 2.0, 0.0]))
    assert sorted(packing.HAND_CHANNELS + packing.NON_HAND_CHANNELS) == list(range(333))
    assert (len(packing.HAND_CHANNELS), len(packing.NON_HAND_CHANNELS)) == (180, 153)
    grouped = [c for group in packing.NORMALISATION_GROUPS for c in group]
    assert sorted(grouped) == list(range(333))


@pytest.mark.parametrize("root", ["velocity", "place"])
def test_what_was_packed_is_the_motion_up_to_where_it_stands(root):
    rot6d, transl = torch.randn(2, 9, 55, 6), torch.randn(2, 9, 3)
    vector = pack(rot6d, transl, root)
    torch.testing.assert_close(vector[..., :ROTATION_DIM].unflatten(-1, (55, 6)), rot6d)
    origin = transl[:, :1] * torch.tensor([1.0, 0.0, 1.0]) if root == "velocity" else 0.0
    found = root_positions(vector[..., ROTATION_DIM:], root)
    torch.testing.assert_close(found, transl - origin, atol=1e-5, rtol=0)


def test_normaliser_shares_one_std_in_a_group():
    vectors = torch.randn(500, 333) * torch.linspace(0.1, 3, 333) + 7
    normaliser = Normaliser.fit(vectors)
    for channels in packing.NORMALISATION_GROUPS:
        assert normaliser.std[channels].unique().numel() == 1
        normal = normaliser.normalise(vectors)[:, channels]
        torch.testing.assert_close(normal.var(0).mean(), torch.tensor(1.0), atol=1e-3, rtol=0)
        torch.testing.assert_close(normal.mean(0), torch.zeros(len(channels)), atol=1e-3, rtol=0)
    torch.testing.assert_close(normaliser.restore(normaliser.normalise(vectors)), vectors)
    raw = Normaliser.fit(vectors, "raw")  # rotations as they are
    torch.testing.assert_close(raw.normalise(vectors)[:, :330], vectors[:, :330])
    torch.testing.assert_close(raw.std[330:], normaliser.std[330:])
    torch.testing.assert_close(raw.mean[330:], normaliser.mean[330:])
    still = Normaliser.fit(torch.ones(10, 333))
    assert torch.isfinite(still.normalise(torch.ones(1, 333))).all()
