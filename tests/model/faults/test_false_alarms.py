"""Nothing is found in people: cuts of three lengths, the whole table of faults, and all periods.

Now and then an arm of the procedural speakers steps to another place from one frame to the next.
That is a fault, whether or not it is found, and cuts that hold one are left out.

``FALSE_ALARM_CLIPS=60`` makes it the run whose numbers are in ``docs/others.md``.
"""

import os
import sys

import numpy as np
import pytest

from model.diagnostics import analyse_raw
from model.faults.analysis import AnalysedMotion
from model.faults.table import find_faults
from model.metrics.lag import speech_bands_by_frame
from model.metrics.posture import WRISTS
from model.motion.kinematics import open_body_skeleton
from model.motion.motion import Motion, load_motion
from model.speech.audio import load_speech
from tests.helpers import beat2_folder
from tests.tools.corpus.conftest import flite
from tests.tools.corpus.made_motion import motion_of
from tools.corpus.clip import make_clip
from tools.corpus.people.rig import open_body_rig
from tools.corpus.people.speaker import SPEAKERS

__all__ = ["flite"]
pytestmark = pytest.mark.slow
CUTS_FRAMES = (300, 1_800, 9_000)
"""10 s, a minute, five minutes."""
STEP_M = 0.03
"""Of a wrist, off the way on which it came, in one frame; recorded: 0.025 at most."""
CLIPS = int(os.environ.get("FALSE_ALARM_CLIPS", "1"))


def largest_step_m(analysed: AnalysedMotion) -> float:
    wrists = analysed.tracks.joints[:, list(WRISTS)] - analysed.tracks.joints[:, :1]
    return float(np.linalg.norm(np.diff(wrists, n=2, axis=0), axis=-1).max())


def told_of(motion: Motion, loud: np.ndarray) -> list[str]:
    """What is said of a clip that has nothing wrong, cut to three lengths; writes how many cuts
    hold a step, which is left out."""
    said: list[str] = []
    for frames in CUTS_FRAMES:
        judged = left_out = 0
        for start in range(0, motion.num_frames, frames):
            cut = motion.part(slice(start, start + frames))
            if cut.num_frames < frames / 2:
                continue  # a rest; it is part of the longer cuts
            heard = loud[start : start + frames]
            analysed = analyse_raw(cut, open_body_skeleton(), speech_log_mel=heard)
            if largest_step_m(analysed) > STEP_M:
                left_out += 1
                continue
            judged += 1
            said += [f"{start}+{frames}: {found.sentence}" for found in find_faults(analysed)]
            if analysed.metrics.seams.period is not None:
                said.append(f"{start}+{frames}: a period of {analysed.metrics.seams.period.frames}")
        sys.stdout.write(f"cuts of {frames} frames: {judged} judged, {left_out} hold a step\n")
    return said


@pytest.mark.parametrize("number", range(CLIPS))
def test_nothing_is_found_in_five_minutes_of_a_procedural_speaker(number, flite):
    speaker = SPEAKERS[number % len(SPEAKERS)]
    clip = make_clip(open_body_rig(), speaker, "train", 300.0, [17, number])
    motion = motion_of(clip)
    assert told_of(motion, speech_bands_by_frame(clip.utterance.waveform)) == []


@pytest.mark.beat2
@pytest.mark.parametrize("name", ["2_scott_0_1_1", "2_scott_0_2_2"])
def test_nothing_is_found_in_a_recording(name):
    folder = beat2_folder()
    motion = load_motion(folder / "smplxflame_30" / f"{name}.npz")
    sound = load_speech(folder / "wave16k" / f"{name}.wav")
    assert told_of(motion, speech_bands_by_frame(sound.waveform)) == []
