"""BeatAlign of EMAGE's trainer, of its later tools and of RAG-Gesture, as their code computes it.

All score onsets against the beats of 13 joints as `model.metrics.beats` does, within a slice of
the clip, weighted by its length. In all three a beat's index counts from the start of the slice,
whereas its speed is compared with the threshold at that index of the whole clip.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.signal import argrelextrema

from conventions.rates import FPS, SAMPLE_RATE
from model.metrics.beats import (
    BEAT_JOINTS,
    MINIMUM_ORDER,
    beat_align_audio_to_motion,
    joint_speeds,
    onsets_between_margins,
    speech_onsets,
    upper_body_beats,
)
from model.metrics.protocols.clip import Clip, Sums

_SAMPLES_A_FRAME = SAMPLE_RATE / FPS


@dataclass(frozen=True)
class BeatAlignVariant:
    """Variant of BeatAlign; its call computes the sums of a clip."""

    threshold_over_mean_speed: float
    """Least speed of a beat, in mean speeds of the joint."""
    margin_frames: int
    """Frames that are left out at both ends."""
    max_frames: int | None = None
    """Number of frames of a clip that are used; all by default."""
    mimics_trainer: bool = False
    """Take the distances of coordinates from their means, which the trainer leaves in the array,
    and the end of the sound from the whole recording."""
    ignores_root_rotation: bool = False
    """Ignore the root's rotation."""

    def __call__(self, clip: Clip) -> Sums:
        assert clip.waveform is not None and clip.published_mean_speeds is not None
        joints = clip.pelvis_aligned[: self.max_frames]
        frames, start = len(joints), int(self.margin_frames * _SAMPLES_A_FRAME)
        audio = clip.waveform[: int(frames * _SAMPLES_A_FRAME)]
        # The trainer takes the end from the whole recording, the others from the motion.
        full = len(clip.waveform) if self.mimics_trainer else len(audio)
        audio = audio[start : full - start]
        if frames <= 2 * self.margin_frames or not len(audio):
            return {}
        if self.ignores_root_rotation:
            joints = np.einsum("tij,tki->tkj", clip.root_rotations[:frames].astype(float), joints)
        if self.mimics_trainer:
            joints = np.abs(joints - joints.mean(axis=0))
        onsets = speech_onsets(audio)
        if not len(onsets):
            return {}
        speeds = joint_speeds(joints[:, BEAT_JOINTS]) / clip.published_mean_speeds
        beats = []
        for speed in speeds.T:
            (minima,) = argrelextrema(
                speed[self.margin_frames : frames - self.margin_frames],
                np.less,
                order=MINIMUM_ORDER,
            )
            beats.append(minima[speed[minima] > self.threshold_over_mean_speed] / FPS)
        count = frames - 2 * self.margin_frames
        score = beat_align_audio_to_motion(onsets, beats)
        return {"count": np.array(float(count)), "beat_align": np.array(score * count)}


def workbench_beat_sums(
    clip: Clip, mean_speed_source: Literal["reference", "own", "emage"]
) -> Sums:
    """Compute the sums of this workbench's BeatAlign (`model.metrics.beats`) for a clip."""
    assert clip.waveform is not None
    mean_speeds = clip.published_mean_speeds
    if mean_speed_source != "emage":
        source = clip.reference if mean_speed_source == "reference" else clip
        assert source is not None
        mean_speeds = joint_speeds(source.pelvis_aligned[:, BEAT_JOINTS]).mean(axis=0)
    assert mean_speeds is not None
    onsets = onsets_between_margins(speech_onsets(clip.waveform), len(clip.joints) / FPS)
    if not len(onsets):
        return {}
    score = beat_align_audio_to_motion(onsets, upper_body_beats(clip.pelvis_aligned, mean_speeds))
    return {"count": np.array(1.0), "beat_align": np.array(score)}
