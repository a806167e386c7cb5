import pytest
import torch

from model.motion.packing import Normaliser, joint_channels
from model.motion.skeleton import FACE
from model.sampling.guidance import SpeechGuide


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
        ("global", 333, joint_channels(FACE)),
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


def test_as_trained_nothing_is_asked_without_speech():
    guide = SpeechGuide(1.0, normaliser(168, mixed=True), "axis-angle")
    batch = torch.randn(2, 4, 168)
    assert guide.copies(2) == 2 and guide.hears(2).tolist() == [True, True]
    assert guide.twice(batch) is batch and guide.guided(batch) is batch


def test_a_batch_asked_twice_hears_first_and_then_does_not():
    guide = SpeechGuide(2.0, normaliser(333, mixed=False), "local")
    assert guide.hears(2).tolist() == [True, True, False, False]
    assert guide.twice(torch.ones(2, 4)).shape == (4, 4)
