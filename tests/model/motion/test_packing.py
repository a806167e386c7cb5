import torch

from conventions.joints import JOINT_INDEX
from model.motion import packing
from model.motion.packing import ROTATION_DIM, Normaliser, pack, root_positions


def test_regions_cover_every_channel_once():
    together = packing.HAND_CHANNELS + packing.TORSO_CHANNELS
    assert sorted(together) == list(range(333))
    assert (len(packing.HAND_CHANNELS), len(packing.TORSO_CHANNELS)) == (180, 153)
    grouped = [c for group in packing.NORMALISATION_GROUPS.values() for c in group]
    assert sorted(grouped) == list(range(333))


def test_layout_is_joint_major_row6d_then_root():
    rot6d = torch.arange(2 * 55 * 6, dtype=torch.float32).reshape(1, 2, 55, 6)
    transl = torch.tensor([[[1.0, 2.0, 3.0], [1.1, 2.5, 2.7]]])
    vector = pack(rot6d, transl)
    wrist = JOINT_INDEX["right_wrist"]
    torch.testing.assert_close(vector[0, 1, 6 * wrist : 6 * wrist + 6], rot6d[0, 1, wrist])
    # 0.1 m and -0.3 m in one frame of 1/30 s; the height stays a position
    torch.testing.assert_close(vector[0, 1, 330:], torch.tensor([3.0, 2.5, -9.0]))
    torch.testing.assert_close(vector[0, 0, 330:], torch.tensor([3.0, 2.0, -9.0]))


def test_packed_motion_is_the_motion_motion_up_to_where_it_stands():
    rot6d, transl = torch.randn(2, 9, 55, 6), torch.randn(2, 9, 3)
    vector = pack(rot6d, transl)
    rot6d_back = vector[..., :ROTATION_DIM].unflatten(-1, (55, 6))
    transl_back = root_positions(vector[..., ROTATION_DIM:])
    torch.testing.assert_close(rot6d_back, rot6d)
    origin = transl[:, :1] * torch.tensor([1.0, 0.0, 1.0])
    torch.testing.assert_close(transl_back, transl - origin, atol=1e-5, rtol=0)


def test_a_place_is_kept_as_it_is():
    rot6d, transl = torch.randn(2, 9, 55, 6), torch.randn(2, 9, 3)
    vector = pack(rot6d, transl, "place")
    torch.testing.assert_close(vector[..., 330:], transl)
    torch.testing.assert_close(root_positions(vector[..., ROTATION_DIM:], "place"), transl)


def test_raw_vectors_keep_their_rotations_and_normalise_the_root():
    vectors = torch.randn(500, 333) * 3 + 5
    raw, usual = Normaliser.fit(vectors, "raw"), Normaliser.fit(vectors)
    torch.testing.assert_close(raw.normalise(vectors)[:, :330], vectors[:, :330])
    torch.testing.assert_close(raw.std[330:], usual.std[330:])
    torch.testing.assert_close(raw.mean[330:], usual.mean[330:])


def test_one_frame_has_no_velocity():
    vector = pack(torch.randn(1, 55, 6), torch.randn(1, 3))
    torch.testing.assert_close(vector[0, [330, 332]], torch.zeros(2))


def test_normaliser_shares_one_std_in_a_group():
    vectors = torch.randn(500, 333) * torch.linspace(0.1, 3, 333) + 7
    normaliser = Normaliser.fit(vectors)
    for channels in packing.NORMALISATION_GROUPS.values():
        assert normaliser.std[channels].unique().numel() == 1
        normal = normaliser.normalise(vectors)[:, channels]
        torch.testing.assert_close(normal.var(0).mean(), torch.tensor(1.0), atol=1e-3, rtol=0)
    torch.testing.assert_close(normaliser.restore(normaliser.normalise(vectors)), vectors)


def test_motionless_channels_do_not_divide_by_zero():
    normaliser = Normaliser.fit(torch.ones(10, 333))
    assert torch.isfinite(normaliser.normalise(torch.ones(1, 333))).all()
