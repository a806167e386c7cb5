"""The curves that drive one hand: one channel a column, 30 rows a second."""

from tools.corpus.gesture.hand_shapes import SHAPE_SIZE

POSITION = slice(0, 3)  # metres, chest frame, x to the body's left
PRONATION, WRIST_FLEX, DEVIATION, ELBOW_OUT = 3, 4, 5, 6  # degrees, degrees, degrees, no unit
FINGERS = slice(7, 7 + SHAPE_SIZE)
NUM_CHANNELS = 7 + SHAPE_SIZE
