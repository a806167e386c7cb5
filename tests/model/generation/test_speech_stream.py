import pytest
import torch

from model.generation.stitching import SpeechStream


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
