import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from app.errors import RunError
from app.live.session import MAX_SOUND_BYTES, read_sound
from app.run.pieces import HEADER, NUM_FACES, frames_message
from tests.helpers import smooth_motion_example


def test_sound_is_read_as_it_was_written() -> None:
    samples = np.array([0, 16384, -32768, 32767], "<i2")
    np.testing.assert_allclose(read_sound(samples.tobytes()), [0, 0.5, -1, 1], atol=1e-4)


@pytest.mark.parametrize(
    ("content", "words"),
    [(b"", "damaged"), (b"abc", "damaged"), (bytes(MAX_SOUND_BYTES + 2), "at most 32000")],
)
def test_other_bytes_are_refused(content: bytes, words: str) -> None:
    with pytest.raises(RunError, match=words):
        read_sound(content)


def test_frames_can_be_read_back_as_the_format_says() -> None:
    motion = smooth_motion_example(7)
    message = frames_message(120, motion, made_ms=61.5, waited_ms=3.0, visitors=2)
    assert HEADER.unpack_from(message) == (120, 7, NUM_FACES, 61.5, 3.0, 2, 0)
    assert HEADER.size == 20
    at = HEADER.size
    trans = np.frombuffer(message, "<f4", 21, at).reshape(7, 3)
    np.testing.assert_array_equal(trans, motion.trans)
    turns = np.frombuffer(message, "<i2", 7 * 55 * 4, at + 84).reshape(-1, 4) / 32_767
    apart = Rotation.from_quat(turns) * Rotation.from_rotvec(motion.poses.reshape(-1, 3)).inv()
    assert apart.magnitude().max() < 2e-4
    faces = np.frombuffer(message, np.uint8, offset=at + 84 + 7 * 440).reshape(7, 52) / 255
    np.testing.assert_allclose(faces, motion.expressions[:, :52].clip(0, 1), atol=0.002)
