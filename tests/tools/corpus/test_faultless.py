"""The findings of the diagnostics have nothing to say about the procedural corpus."""

import numpy as np

from model.diagnostics.diagnostics import diagnose
from model.measures.seams.seams import Windows
from model.motion.motion import Motion
from model.motion.skeleton import open_body_skeleton
from tools.corpus.clip import Clip


def test_no_fault_is_found_in_any_clip(clips: dict[str, Clip]) -> None:
    for clip in clips.values():
        motion = Motion(
            poses=np.asarray(clip.poses, np.float32).reshape(-1, 165),
            trans=np.asarray(clip.trans, np.float32),
            expressions=np.asarray(clip.expressions, np.float32),
            expression_basis="arkit52",
            betas=np.zeros(300, np.float32),
        )
        cuts = [motion, *(motion.part(slice(start, start + 300)) for start in range(0, 900, 300))]
        for cut in cuts:
            for windows in ({}, {"a": Windows(52, 8)}):
                assert diagnose({"a": cut}, open_body_skeleton(), windows=windows).findings == {
                    "a": []
                }
