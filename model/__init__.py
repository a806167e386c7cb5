"""Speech features, motion, networks, training, systems, measures and evaluation;
imports neither ``app`` nor ``renderer``.
"""

import os

# Read when torch is first imported. Threads that wait for each other by turning in a loop hold up
# whatever else wants their core, and are held up by it: beside one other busy process a step of two
# threads then takes thirty times as long. Asleep, they cost next to nothing on a quiet machine.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
