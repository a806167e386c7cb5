"""What is measured on a few clips only, since it takes motions of its own: manner and silence.

The first seconds of a clip's speech and then silence, moved by a calm speaker and by a lively one
under the same noise.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

import numpy as np

from conventions.rates import FPS, SAMPLE_RATE
from model.data.recordings import DataError, read_files, read_split, speaker_of
from model.evaluation.speakers import manner_of, wrist_speed_m_s
from model.generation.base import System
from model.generation.clip_noise import clip_seed
from model.generation.windows import GenerateOptions, generate_motion
from model.measures.hearing import LEAST_FRAMES, SILENCE_S, speed_in_silence
from model.motion.motion import Motion, first_frames
from model.speech.audio import Speech, SpeechError
from model.storage.npz import MotionError

NUM_CLIPS = 6
SPEECH_S = 10.0
"""Of each clip, at most."""
NOISE_SEEDS = 2
UNKNOWN_SPEAKERS = "Speakers are not compared: not every system knows those that were asked for."


@dataclass(frozen=True)
class FewClips:
    """Which clips, and who moves in them."""

    names: tuple[str, ...]
    speakers: tuple[str, str] | None
    """A calm one and a lively one; None where not every system knows them: then each clip's own
    speaker moves, and manner is left out."""
    recorded: Mapping[str, tuple[str, str]]
    """By clip, a recording of the calm speaker and one of the lively."""

    @staticmethod
    def choose(
        folder: Path,
        clips: Sequence[str],
        systems: Sequence[System],
        speakers: tuple[str, str],
        count: int = NUM_CLIPS,
    ) -> "FewClips":
        """The first of the clips, and recordings of the speakers from any split."""
        names = tuple(clips[:count])
        if not all(speaker in system.speakers for system in systems for speaker in speakers):
            return FewClips(names, None, {})
        calm, lively = (_recordings(folder, speaker, len(names)) for speaker in speakers)
        recorded = dict(zip(names, zip(calm, lively, strict=False), strict=False))
        return FewClips(names, speakers, recorded)

    def left_out(self) -> list[str]:
        """A sentence where speakers are not compared."""
        if self.speakers is not None:
            return []
        return [UNKNOWN_SPEAKERS]

    def recorded_measures(self, folder: Path, name: str) -> dict[str, float]:
        """Wrist speeds of the recordings that go with clip ``name``; nothing where there are
        none."""
        if name not in self.recorded:
            return {}
        calm, lively = (read_files(folder, clip)[0] for clip in self.recorded[name])
        return _wrist_speeds([calm], [lively])

    def measures(
        self, system: System, name: str, speech: Speech, guidance: float | None
    ) -> dict[str, float]:
        """Of a system, on clip ``name``; nothing on a clip that is not among the few."""
        if name not in self.names:
            return {}
        heard = with_silence(speech)
        spoken = heard.num_frames - round(SILENCE_S * FPS)
        speakers = self.speakers or (speaker_of(name)[1],)
        moved = {
            speaker: generate_motion(
                system,
                heard,
                GenerateOptions(
                    speaker, seed=clip_seed(0, name), samples=NOISE_SEEDS, guidance=guidance
                ),
            )
            for speaker in speakers
        }
        motions = [motion for own in moved.values() for motion in own]
        voiced = np.arange(heard.num_frames) < spoken
        silences = [speed_in_silence(motion, voiced) for motion in motions]
        found = {
            key: float(np.mean([one[key] for one in silences]))
            for key in silences[0]
            if all(key in one for one in silences)
        }
        if self.speakers is None or spoken < LEAST_FRAMES:
            return found
        speaking = {
            (speaker, seed): first_frames(motion, spoken)
            for speaker, own in moved.items()
            for seed, motion in enumerate(own)
        }
        manner = manner_of(speaking)
        calm, lively = (
            [motion for (speaker, _), motion in speaking.items() if speaker == which]
            for which in self.speakers
        )
        return found | {
            "arms_by_speaker": manner.by_speaker,
            "arm_rotations_other_speaker": manner.arm_rotations_same_noise,
            **_wrist_speeds(calm, lively),
        }


def with_silence(speech: Speech) -> Speech:
    """The first `SPEECH_S` of a speech, and `SILENCE_S` of digital silence after it."""
    said = speech.waveform[: round(SPEECH_S * SAMPLE_RATE)]
    silence = np.zeros(round(SILENCE_S * SAMPLE_RATE), np.float32)
    return replace(speech, waveform=np.concatenate([said, silence]))


def _wrist_speeds(calm: Sequence[Motion], lively: Sequence[Motion]) -> dict[str, float]:
    slow, fast = (float(np.mean([*map(wrist_speed_m_s, own)])) for own in (calm, lively))
    return {"calm_wrist_m_s": slow, "lively_wrist_m_s": fast}


def _recordings(folder: Path, speaker: str, count: int) -> list[str]:
    """Names of a speaker's first recordings that can be read."""

    def is_readable(name: str) -> bool:
        try:
            read_files(folder, name)
        except (DataError, MotionError, SpeechError):
            return False
        return True

    own = (name for name in sorted(read_split(folder)) if speaker_of(name)[1] == speaker)
    return list(islice(filter(is_readable, own), count))
