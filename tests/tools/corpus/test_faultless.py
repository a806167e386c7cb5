"""The findings of the diagnostics have nothing to say about the procedural corpus."""

from model.diagnostics import diagnose
from model.measures.seams import Windows
from model.motion.kinematics import open_body_skeleton
from tests.tools.corpus.made_motion import motion_of
from tools.corpus.clip import Clip


def test_no_fault_is_found_in_any_clip(clips: dict[str, Clip]) -> None:
    for clip in clips.values():
        motion = motion_of(clip)
        cuts = [motion, *(motion.part(slice(start, start + 300)) for start in range(0, 900, 300))]
        for cut in cuts:
            for windows in ({}, {"a": Windows(52, 8)}):
                assert diagnose({"a": cut}, open_body_skeleton(), windows=windows).findings == {
                    "a": []
                }
