"""Speech features, motion, networks, training, systems, metrics and evaluation.

The package imports neither ``app`` nor ``renderer``.
"""

import os

# Read when torch is first imported. Threads that wait for each other by spinning occupy a core that
# other processes need, and are slowed down by them: with one other busy process a step of two
# threads then takes thirty times as long. Asleep, they cost next to nothing on a quiet machine.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
