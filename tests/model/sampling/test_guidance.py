import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from conventions.joints import FACE, JOINT_INDEX
from model.motion.packing import Normaliser, joint_channels
from model.motion.rotations import matrix_from_rot6d, rot6d_from_matrix
from model.sampling.flow import SpeechGuide


def normaliser(channels: int, mixed: bool) -> Normaliser:
    generator = torch.Generator().manual_seed(1)
    mean, std = torch.randn(channels, generator=generator), torch.rand(channels) + 0.5
    if not mixed:
        return Normaliser(mean, std)
    mix = torch.linalg.qr(torch.randn(channels, channels, generator=generator))[0]
    return Normaliser(mean, std, mix * 2, mix.T / 2)


@pytest.mark.parametrize(
    ("space", "channels", "face"),
    [
        ("local", 333, joint_channels(FACE)),
        ("axis-angle", 168, [3 * joint + k for joint in FACE for k in range(3)]),
    ],
)
@pytest.mark.parametrize("strength", [0.0, 0.5, 2.5])
def test_the_body_moves_along_what_speech_changes_and_the_jaw_stays(
    space, channels, face, strength
):
    numbers = normaliser(channels, mixed=space == "axis-angle")
    heard, deaf = torch.randn(2, 3, 7, channels)
    guide = SpeechGuide(strength, numbers, space)
    found = numbers.restore(guide.guided(torch.cat([heard, deaf])))
    with_speech, without = numbers.restore(heard), numbers.restore(deaf)
    wanted = without + strength * (with_speech - without)
    wanted[..., face] = with_speech[..., face]
    torch.testing.assert_close(found, wanted, atol=1e-4, rtol=1e-4)


def test_neck_and_head_may_hear_at_a_strength_of_their_own():
    numbers = normaliser(168, mixed=True)
    heard, deaf = torch.randn(2, 3, 7, 168)
    both = torch.cat([heard, deaf])
    head = [3 * JOINT_INDEX[joint] + k for joint in ("neck", "head") for k in range(3)]
    body, stronger, mixed = (
        numbers.restore(SpeechGuide(strength, numbers, "axis-angle", of_head).guided(both))
        for strength, of_head in ((1.4, None), (2.4, None), (1.4, 2.4))
    )
    body[..., head] = stronger[..., head]
    torch.testing.assert_close(mixed, body, atol=1e-4, rtol=1e-4)
    assert SpeechGuide(1.0, numbers, "axis-angle", 2.0).asks_twice


def test_in_the_world_the_jaw_goes_with_the_head_and_stays_in_it():
    """Heads that speech turns about one axis: at any strength the jaw is where it was in them."""
    numbers = normaliser(333, mixed=False)
    head, jaw = JOINT_INDEX["head"], JOINT_INDEX["jaw"]

    def vectors(heads: np.ndarray) -> torch.Tensor:
        rotations = np.tile(np.eye(3), (2, 55, 1, 1))
        rotations[:, head] = heads
        in_head = Rotation.from_rotvec([[0.2, 0.0, 0.1], [0.4, 0.1, 0.0]]).as_matrix()
        rotations[:, jaw] = heads @ in_head
        rows = rot6d_from_matrix(torch.tensor(rotations, dtype=torch.float32))
        return torch.cat([rows.flatten(-2), torch.zeros(2, 3)], dim=-1)

    turned = Rotation.from_rotvec([[0.0, 0.02, 0.0], [0.0, -0.02, 0.01]]).as_matrix()
    told = [numbers.normalise(vectors(heads))[None] for heads in (turned, np.eye(3)[None])]
    guide = SpeechGuide(2.5, numbers, "global")
    found = numbers.restore(guide.guided(torch.cat(told)))[0]
    rotations = matrix_from_rot6d(found[:, :330].unflatten(-1, (55, 6))).numpy()
    in_head = np.swapaxes(rotations[:, head], -1, -2) @ rotations[:, jaw]
    wanted = Rotation.from_rotvec([[0.2, 0.0, 0.1], [0.4, 0.1, 0.0]]).as_matrix()
    np.testing.assert_allclose(in_head, wanted, atol=2e-3)
    angles = Rotation.from_matrix(rotations[:, head]).magnitude()
    np.testing.assert_allclose(angles, [2.5 * 0.02, 2.5 * np.hypot(0.02, 0.01)], rtol=0.01)


def test_as_trained_nothing_is_asked_without_speech():
    guide = SpeechGuide(1.0, normaliser(168, mixed=True), "axis-angle")
    batch = torch.randn(2, 4, 168)
    assert guide.copies(2) == 2 and guide.hears(2).tolist() == [True, True]
    assert guide.twice(batch) is batch and guide.guided(batch) is batch


def test_a_batch_asked_twice_hears_first_and_then_does_not():
    guide = SpeechGuide(2.0, normaliser(333, mixed=False), "local")
    assert guide.hears(2).tolist() == [True, True, False, False]
    assert guide.twice(torch.ones(2, 4)).shape == (4, 4)
