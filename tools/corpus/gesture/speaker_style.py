"""Gesture style of a speaker: random variation of the library's poses."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from tools.corpus.gesture.gestures import (
    ABDUCTION,
    FLEX,
    NEUTRAL,
    REST,
    SHAPES,
    THUMB,
    GestureShape,
    HandPose,
)
from tools.corpus.people.speaker import Speaker

IDLE_SHAPES = ("relaxed", "lazy", "half_open", "bowl", "soft_pinch")
BEAT_SHAPES = ("relaxed", "half_open", "bowl", "soft_pinch", "cage", "lazy", "flat", "wave_out")
NEVER_FLAT_DEG = 5.0  # people's fingers stay a little bent
Choice = TypeVar("Choice")


class PoseSampler:
    """Random poses of one speaker from one generator."""

    def __init__(self, speaker: Speaker, rng: np.random.Generator):
        self.speaker = speaker
        self.rng = rng
        self._offset = np.array([speaker.outward_m, speaker.height_m, speaker.forward_m])

    def fingers(self, shape: str, curl_deg: float = 0.0) -> np.ndarray:
        """Draw a hand shape in the speaker's style, never twice the same."""
        rng = self.rng
        fingers = SHAPES[shape].copy()
        fingers[FLEX] *= self.speaker.finger_curl * (1.0 + rng.normal(0, 0.13))
        fingers[FLEX] += NEVER_FLAT_DEG + curl_deg + np.repeat(rng.normal(0, 3.5, 4), 3)
        fingers[ABDUCTION] += rng.normal(0, 2.5, 4)
        fingers[THUMB] += rng.normal(0, 5.0, 3)
        return fingers

    def idle_fingers(self) -> np.ndarray:
        """Draw the shape of an idle hand, often the speaker's habitual one."""
        habit = self.speaker.idle_shape if self.rng.random() < 0.6 else pick(self.rng, IDLE_SHAPES)
        return self.fingers(habit)

    def rest_pose(self, name: str) -> HandPose:
        """Draw one of the library's rest poses, without the speaker's style."""
        return self._varied(REST[name], 0.008 if name == "hang" else 0.012, styled=False)

    def _varied(
        self, pose: HandPose, sd_m: float, size: float = 1.0, styled: bool = True
    ) -> HandPose:
        """Scale a pose to the speaker's gesture space about its middle, and add noise."""
        rng, speaker = self.rng, self.speaker
        centre = np.array([0.17, -0.14, 0.25])
        position = pose.position
        if styled:
            wider = min(size, 1.0) * max(size, 1.0) ** 0.4
            position = centre + (position - centre) * [wider, size, size**0.7]
            position = position + self._offset
        habit = 1.0 if styled else 0.0
        return HandPose(
            position + rng.normal(0, sd_m, 3) * [1, 1, 0.8],
            pose.palm + rng.normal(0, 0.12, 3) + habit * np.array([0.0, speaker.palm_up, 0.0]),
            pose.flex_deg + rng.normal(0, 5) + habit * speaker.wrist_deg,
            pose.deviation_deg + rng.normal(0, 4),
            pose.elbow_out + rng.normal(0, 0.08) + habit * speaker.elbow_out,
            pose.fingers,
        )

    def styled(
        self, name: str, gesture: GestureShape, size: float
    ) -> tuple[HandPose, HandPose, list[tuple[float, HandPose]]]:
        """Draw preparation, stroke and via poses of a gesture with hand shapes."""
        rng, speaker = self.rng, self.speaker
        prepare = self._varied(gesture.prepare, 0.024, size)
        stroke = self._varied(gesture.stroke, 0.022, size)
        shape = _shape_name(gesture.stroke)
        if gesture.shapes and rng.random() < 0.6:
            shape = pick(rng, gesture.shapes)
        if name == "beat":
            shape = speaker.beat_shape if rng.random() < 0.6 else pick(rng, BEAT_SHAPES)
        before = _shape_name(gesture.prepare)
        if before == "relaxed":
            before = pick(rng, IDLE_SHAPES)
        prepare = replace(prepare, fingers=self.fingers(before, rng.uniform(0, 8)))
        stroke = replace(stroke, fingers=self.fingers(shape, rng.uniform(-8, 0)))
        via = [
            (share, replace(self._varied(pose, 0.015, size), fingers=prepare.fingers))
            for share, pose in gesture.via
        ]
        return prepare, stroke, via

    def vary_second_hand(self, prepare: HandPose, stroke: HandPose) -> tuple[HandPose, HandPose]:
        """Vary the poses for the second hand: lower, smaller, turned a little."""
        rng = self.rng
        offset = rng.normal(0, 0.032, 3) * [0.6, 1.2, 1.0] - [0.0, 0.015, 0.0]
        share = rng.uniform(0.6, 1.0)
        turn = rng.normal(0, 0.2, 3)
        own_stroke = prepare.position + share * (stroke.position - prepare.position)
        own_fingers = stroke.fingers.copy()
        own_fingers[FLEX] += np.repeat(rng.normal(0, 6.0, 4), 3)
        return (
            replace(prepare, position=prepare.position + offset, palm=prepare.palm + turn),
            replace(
                stroke, position=own_stroke + offset, palm=stroke.palm + turn, fingers=own_fingers
            ),
        )

    def relaxed_towards_centre(self, pose: HandPose, share: float) -> HandPose:
        """Move a pose by ``share`` towards the middle of the gesture space."""
        rng = self.rng
        centre = NEUTRAL + self._offset + np.array([0.0, -0.03, -0.01])
        fingers = pose.fingers + 0.5 * share * (SHAPES["half_open"] - pose.fingers)
        fingers[FLEX] += np.repeat(rng.normal(0, 4.0, 4), 3)
        fingers[ABDUCTION] += rng.normal(0, 1.5, 4)
        return replace(
            pose,
            position=pose.position + share * (centre - pose.position) + rng.normal(0, 0.016, 3),
            palm=pose.palm + rng.normal(0, 0.09, 3),
            flex_deg=pose.flex_deg * (1 - 0.5 * share) + rng.normal(0, 4),
            fingers=fingers,
        )

    def beat_poses(
        self, held: HandPose, depth_m: float, aside_m: float
    ) -> tuple[HandPose, HandPose]:
        """Draw the up and down poses of a beat: with the arm, or by turning forearm and wrist."""
        rng = self.rng
        travel, bend, turn = pick(
            rng, ((1.0, 1.0, 0.0), (1.0, 1.0, 0.25), (0.45, 2.0, 0.1), (0.4, 0.6, 0.8))
        )
        rise = travel * depth_m * rng.uniform(0.5, 0.85)
        ahead = rng.uniform(-0.015, 0.06) * travel
        twist = turn * rng.choice([-1.0, 1.0]) * np.array([rng.uniform(0.5, 1), 0.6, 0.0])
        up_fingers, down_fingers = held.fingers.copy(), held.fingers.copy()
        up_fingers[FLEX] += np.repeat(rng.uniform(1, 10) + rng.normal(0, 4, 4), 3)
        down_fingers[FLEX] += np.repeat(rng.uniform(-9, 1) + rng.normal(0, 4, 4), 3)
        down_fingers[ABDUCTION] += rng.normal(0.0, 2.5, 4)
        if rng.random() < 0.3:
            down_fingers = self.fingers(pick(rng, BEAT_SHAPES))
        up = replace(
            held,
            position=held.position + np.array([aside_m, rise, -0.5 * ahead]),
            palm=held.palm + rng.normal(0, 0.2, 3) - 0.5 * twist,
            flex_deg=held.flex_deg - 13.0 * bend,
            deviation_deg=held.deviation_deg + rng.uniform(0, 8),
            fingers=up_fingers,
        )
        down = replace(
            held,
            position=held.position
            + np.array([0.5 * aside_m, -0.45 * rise, ahead])
            + rng.normal(0, 0.008, 3),
            palm=held.palm + twist,
            flex_deg=held.flex_deg + rng.uniform(6, 18) * bend,
            fingers=down_fingers,
        )
        return up, down


def off_neutral_share(pose: HandPose) -> float:
    """Return 0 in the middle of the gesture space, rising to 1 at 20 cm."""
    return float(np.clip(np.linalg.norm(pose.position - NEUTRAL) / 0.2, 0.0, 1.0))


def _shape_name(pose: HandPose) -> str:
    """Return the name of the library's hand shape of a pose."""
    return next(name for name, shape in SHAPES.items() if shape is pose.fingers)


def pick(rng: np.random.Generator, choices: Sequence[Choice]) -> Choice:
    return choices[int(rng.integers(len(choices)))]
