"""Sizes and channels of the authors' networks (Xiangyue-Zhang/GlobalDiff). Needs no torch."""

SPEECH_DIM = 1024
EXPRESSION_DIM = 100
MOTION_DIM = 333
"""55 joints of 6 numbers, then the translation."""
NUM_SPEAKERS = 31
SPEAKER_DIM = 64
WINDOW_FRAMES = 60
SEED_FRAMES = 8

_TORSO = (3, 6, 9, *range(12, 22))
_LEGS = (0, 1, 2, 4, 5, 7, 8, 10, 11)
_HEAD = (22, 23, 24)
_FINGERS = tuple(range(25, 55))


def _channels(joints: tuple[int, ...]) -> tuple[int, ...]:
    return tuple(6 * joint + k for joint in joints for k in range(6))


HAND_CHANNELS = _channels(_FINGERS)
BODY_CHANNELS = (*_channels((*_TORSO, *_LEGS)), 330, 331, 332, *_channels(_HEAD))
"""In the order in which the body branch has them, the translation between legs and head."""
