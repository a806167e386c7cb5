"""Clips of the corpus as the measures take them."""

import numpy as np

from model.motion.motion import Motion
from tools.corpus.clip import CorpusClip


def motion_of(clip: CorpusClip) -> Motion:
    return Motion(
        poses=np.asarray(clip.poses, np.float32).reshape(-1, 165),
        trans=np.asarray(clip.trans, np.float32),
        expressions=np.asarray(clip.expressions, np.float32),
        expression_basis="arkit52",
        betas=np.zeros(300, np.float32),
    )
