import pytest
import torch

from model.networks.expression import Face, SpeechStream
from model.systems.base import load_face
from tests.model.made import TINY_EXPRESSION, make_weights

HEARD = 60 + 2 * TINY_EXPRESSION.speech_context


@pytest.fixture(scope="module")
def face(tmp_path_factory) -> Face:
    return load_face(make_weights(tmp_path_factory.mktemp("weights")))


def test_a_face_is_drawn_anew_from_other_noise_and_stays_in_range(face):
    speech = torch.randn(1, HEARD, 68)
    one, other = (face.draw(speech, 1, None, face.noise(seed, 0))[0] for seed in (0, 1))
    assert one.shape == (1, 60, 52)
    assert one.min() >= 0 and one.max() <= 1
    assert (one - other).abs().max() > 0.05
    torch.testing.assert_close(one, face.draw(speech, 1, None, face.noise(0, 0))[0])


def test_a_window_goes_on_from_the_one_before(face):
    speech = torch.randn(1, HEARD, 68)
    first, seed = face.draw(speech, 1, None, face.noise(0, 0))
    after, _ = face.draw(speech, 1, seed, face.noise(0, 1))
    assert (after[:, :8] - first[:, -8:]).abs().mean() < 0.2 * first.std()


def test_windows_of_a_batch_do_not_mix(face):
    speech = torch.randn(3, HEARD, 68)
    noise = torch.cat([face.noise(0, k) for k in range(3)])
    together, _ = face.draw(speech, 1, None, noise)
    alone, _ = face.draw(speech[1:2], 1, None, noise[1:2])
    torch.testing.assert_close(together[1:2], alone, atol=1e-4, rtol=1e-4)


@pytest.mark.parametrize("sizes", [[200], [1, 60, 17, 100, 22], [7] * 28 + [4]])
def test_windows_of_a_stream_are_those_of_the_whole_with_both_ends_held(sizes):
    features = torch.arange(200.0)[:, None].expand(-1, 3)
    stream = SpeechStream(features.split(sizes), context=20)
    for index, start in enumerate(range(0, 200, 52)):
        window = stream.window(start, 60)
        wanted = torch.arange(start - 20, start + 80).clamp(0, 199).float()
        torch.testing.assert_close(window.speech[:, 0], wanted)
        assert window.num_frames == min(60, 200 - start)
        assert window.is_last == (start + 60 >= 200)
        torch.testing.assert_close(window.around(0, 60)[:, 0], wanted[20:80])
        torch.testing.assert_close(window.around(5, 60)[:, 0], wanted[15:85])
        if window.is_last:
            assert index == 3
            break


def test_speech_that_has_ended_has_no_further_window():
    stream = SpeechStream([torch.zeros(30, 3)], context=4)
    with pytest.raises(ValueError, match="no frame 30"):
        stream.window(30, 60)
    with pytest.raises(ValueError, match="no frame 0"):
        SpeechStream([], context=4).window(0, 60)
