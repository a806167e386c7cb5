"""Gesture plan of a clip: for each hand a list of keys in order of arrival.

Every phrase is cut into chunks of about two seconds. A chunk may have one gesture (Kendon's
preparation and stroke, the stroke's end on the stressed vowel), beats on its later accents, and a
hold that slowly relaxes; in pauses between phrases the hands retract.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from model.plan.plan import Phase
from tools.corpus.gesture.choice import GestureSelector
from tools.corpus.gesture.gestures import FLEX, GESTURES, HandPose
from tools.corpus.gesture.speaker_style import PoseSampler, off_neutral_share
from tools.corpus.people.rig import SIDE_SIGN, SIDES
from tools.corpus.people.speaker import Speaker
from tools.corpus.words.prosody import Phrase, Utterance

GESTURE_FROM_ACCENT = 0.62  # prominence of the strongest word of a chunk, for a rate of 1


@dataclass(frozen=True)
class HandKey:
    """Pose that a hand reaches at ``arrive_s`` by a move of ``duration_s``."""

    arrive_s: float
    duration_s: float
    pose: HandPose
    phase: Phase
    gesture: str
    word: str = ""
    """Word at the end of a stroke."""


@dataclass(frozen=True)
class CycleSpan:
    """Circling of a gesture on one side from ``start_s`` to ``end_s``."""

    side: str
    start_s: float
    end_s: float
    vertical_m: float
    forward_m: float
    hz: float
    phase_rad: float


@dataclass
class HandPlan:
    """Keys by side, cycles, and spans of shrugged shoulders."""

    keys: dict[str, list[HandKey]] = field(default_factory=dict)
    cycles: list[CycleSpan] = field(default_factory=list)
    shrugs: list[tuple[float, float]] = field(default_factory=list)


def make_plan(utterance: Utterance, speaker: Speaker, rng: np.random.Generator) -> HandPlan:
    """Plan the gestures of an utterance."""
    planner = _Planner(utterance, speaker, rng)
    for number, phrase in enumerate(utterance.phrases):
        for chunk in planner.chunks(phrase):
            if planner.calls_for_a_gesture(chunk):
                planner.gesture(chunk)
        is_last = number + 1 == len(utterance.phrases)
        next_s = utterance.duration_s if is_last else utterance.phrases[number + 1].start_s
        if any(span.start_s < next_s and span.end_s > phrase.end_s for span in utterance.listening):
            planner.listen(phrase)
        else:
            planner.pause(phrase, next_s + is_last - phrase.end_s)
    return planner.plan


class _Planner:
    """Planner that goes through the phrases and stores each hand's keys."""

    def __init__(self, utterance: Utterance, speaker: Speaker, rng: np.random.Generator):
        self.utterance = utterance
        self.speaker = speaker
        self.rng = rng
        self.manner = PoseSampler(speaker, rng)
        self.choice = GestureSelector(utterance.words, utterance.phrases, speaker, rng)
        first_s = utterance.phrases[0].start_s
        listens = any(span.start_s < first_s for span in utterance.listening)
        rests = speaker.listening_rest_of if listens else speaker.rest_of
        rest = {side: self.manner.rest_pose(rests(side)) for side in SIDES}
        self.plan = HandPlan({side: [HandKey(-1.0, 0.5, rest[side], "rest", "")] for side in SIDES})

    def chunks(self, phrase: Phrase) -> list[range]:
        """Split a phrase into runs of words of about two seconds."""
        words = self.utterance.words
        starts = [phrase.words.start]
        for k in phrase.words[1:]:
            if words[k].start_s - words[starts[-1]].start_s > self.rng.uniform(1.3, 2.3):
                starts.append(k)
        stops = [*starts[1:], phrase.words.stop]
        return [range(a, b) for a, b in zip(starts, stops, strict=True)]

    def calls_for_a_gesture(self, chunk: range) -> bool:
        """Check whether a chunk is stressed enough for a gesture."""
        strongest = max(self.utterance.words[k].accent for k in chunk)
        return strongest > GESTURE_FROM_ACCENT - 0.25 * (min(self.speaker.rate, 1.2) - 1.0)

    def gesture(self, chunk: range) -> None:
        """Plan one gesture, its beats and its hold."""
        rng, speaker, words = self.rng, self.speaker, self.utterance.words
        name, word_index = self.choice.gesture(chunk)
        gesture = GESTURES[name]
        aside_m = self.choice.aside_m(word_index)
        hands = self.choice.hands(gesture, aside_m, word_index)
        word = words[word_index]
        apex_s = word.beat_s - rng.normal(0.05, 0.03)
        end_s = words[chunk[-1]].end_s
        size = min(
            speaker.amplitude * (0.7 + 0.7 * max(word.accent, 0.4)) * rng.uniform(0.94, 1.06), 1.6
        )
        if gesture.shrugs:
            self.plan.shrugs.append((apex_s, end_s + 0.2))
        prepare, stroke, via = self.manner.styled(name, gesture, size)
        beats = self._beats(chunk, apex_s)
        wander = rng.normal(0.0, 0.03, len(beats))
        for order, side in enumerate(hands):
            second = order == 1
            lag = rng.normal(0.04, 0.035) if second else 0.0
            own_prepare, own_stroke = prepare, stroke
            if second:
                own_prepare, own_stroke = self.manner.vary_second_hand(prepare, stroke)
            own_stroke = _moved(own_stroke, aside_m * SIDE_SIGN[side])
            own_via = [(share, _moved(p, share * aside_m * SIDE_SIGN[side])) for share, p in via]
            self._stroke(side, name, word.text, apex_s + lag, own_prepare, own_stroke, own_via)
            if gesture.cycle is not None:
                self.plan.cycles.append(
                    CycleSpan(
                        side,
                        apex_s + lag,
                        max(end_s, apex_s + lag + 0.7),
                        gesture.cycle.vertical_m * size,
                        gesture.cycle.forward_m * size,
                        gesture.cycle.hz * speaker.tempo,
                        np.pi if second and gesture.cycle.alternates else 0.0,
                    )
                )
            depth = 0.8 if second else 1.0
            self._beat_moves(side, name, [(b + lag, d * depth) for b, d in beats], wander)
            self._hold(side, name, end_s)
        for side in SIDES:
            if side not in hands:
                self._idle(side, apex_s, beats)

    def listen(self, phrase: Phrase) -> None:
        """Plan the retraction of both hands within about a second, for listening."""
        rng, speaker = self.rng, self.speaker
        for side in SIDES:
            keys = self.plan.keys[side]
            while keys[-1].phase == "hold" and keys[-1].arrive_s > phrase.end_s:
                keys.pop()
            arrive_s = max(phrase.end_s + rng.uniform(0.85, 1.1), keys[-1].arrive_s + 0.6)
            pose = self.manner.rest_pose(speaker.listening_rest_of(side))
            pose = replace(pose, fingers=self.manner.fingers("lazy"))
            self._add(side, arrive_s, rng.uniform(0.85, 1.1), pose, "retraction", "")
        self.choice.hands_rested()

    def pause(self, phrase: Phrase, gap_s: float) -> None:
        """Plan a pause: retract in a long one, sink in a short one."""
        rng, speaker = self.rng, self.speaker
        for side in SIDES:
            last = self._last(side)
            tired = phrase.ends_sentence and gap_s > 0.45 and rng.random() < 0.3
            if gap_s > speaker.pause_threshold_s or tired:
                start_s = max(phrase.end_s + rng.uniform(0.05, 0.3), last.arrive_s + 0.2)
                duration_s = rng.uniform(0.65, 1.05)
                pose = self.manner.rest_pose(speaker.rest_of(side))
                self._add(side, start_s + 0.8 * duration_s, duration_s, pose, "retraction", "")
                self.choice.hands_rested()
            elif gap_s > 0.3 and last.arrive_s < phrase.end_s + 0.1:
                sink = [rng.normal(0.01, 0.015), -rng.uniform(0.02, 0.07), -rng.uniform(0.0, 0.04)]
                pose = replace(last.pose, position=last.pose.position + sink)
                if rng.random() < 0.6:
                    pose = replace(pose, fingers=self.manner.idle_fingers())
                self._add(side, phrase.end_s + 0.35, 0.6, pose, "hold", last.gesture)

    # Keys

    def _last(self, side: str) -> HandKey:
        return self.plan.keys[side][-1]

    def _add(
        self,
        side: str,
        arrive_s: float,
        duration_s: float,
        pose: HandPose,
        phase: Phase,
        name: str,
        word: str = "",
    ) -> None:
        """Append a key; a minimum-jerk move of d metres lasts at least 1.875 d / v_max."""
        distance_m = float(np.linalg.norm(pose.position - self._last(side).pose.position))
        top_speed = self.rng.uniform(1.05, 1.6) * self.speaker.tempo**0.5
        duration_s = max(duration_s, 1.875 * distance_m / top_speed)
        self.plan.keys[side].append(HandKey(arrive_s, duration_s, pose, phase, name, word))

    def _stroke(
        self,
        side: str,
        name: str,
        word: str,
        apex_s: float,
        prepare: HandPose,
        stroke: HandPose,
        via: list[tuple[float, HandPose]],
    ) -> None:
        """Plan a preparation, if there is time, and the stroke that ends at ``apex_s``."""
        rng, tempo = self.rng, self.speaker.tempo
        noise = rng.normal(0, 0.012, 3)
        prepare = replace(prepare, position=prepare.position + noise)
        stroke = replace(stroke, position=stroke.position + rng.normal(0, 0.012, 3))
        length_m = float(np.linalg.norm(stroke.position - prepare.position))
        stroke_s = min(0.26 + 0.75 * length_m, 0.55) / tempo * rng.uniform(0.9, 1.15)
        approach_m = float(np.linalg.norm(prepare.position - self._last(side).pose.position))
        prepare_s = min(0.30 + 0.9 * approach_m, 0.75) / tempo * rng.uniform(0.95, 1.2)
        room_s = apex_s - 0.8 * stroke_s - self._last(side).arrive_s
        has_room = room_s > 0.22
        if has_room:
            arrive_s = apex_s - 0.72 * stroke_s
            self._add(side, arrive_s, min(prepare_s, room_s + 0.18), prepare, "preparation", name)
        for share, pose in via:
            arrive_s = apex_s - 0.8 * stroke_s * (1 - share)
            if arrive_s > self._last(side).arrive_s + 0.05:
                self._add(side, arrive_s, 0.7 * stroke_s, pose, "stroke", name)
        since_s = apex_s + 0.03 - self._last(side).arrive_s
        if not has_room:
            stroke_s = max(min(stroke_s + 0.12, since_s + 0.1), 0.28)
        arrive_s = max(apex_s + 0.03, self._last(side).arrive_s + 0.16)
        self._add(side, arrive_s, stroke_s, stroke, "stroke", name, word)

    def _beats(self, chunk: range, apex_s: float) -> list[tuple[float, float]]:
        """Draw times (s) and depths (m) of the beats after the stroke."""
        rng, speaker = self.rng, self.speaker
        beats: list[tuple[float, float]] = []
        for k in chunk:
            word = self.utterance.words[k]
            beat_s = word.beat_s - rng.normal(0.04, 0.03)
            apart = not beats or beat_s - beats[-1][0] > 0.30
            is_beaten = word.accent > 0 and rng.random() < speaker.rate * speaker.beats
            if beat_s > apex_s + 0.34 and apart and is_beaten:
                depth_m = (0.02 + 0.11 * word.accent) * rng.uniform(0.85, 1.15)
                beats.append((beat_s, depth_m * speaker.amplitude))
        return beats

    def _beat_moves(
        self,
        side: str,
        name: str,
        beats: list[tuple[float, float]],
        wander: Float[np.ndarray, " beats"],
    ) -> None:
        """Plan up and down moves for every beat with enough time."""
        rng, manner = self.rng, self.manner
        for (beat_s, depth_m), aside_m in zip(beats, wander, strict=True):
            last = self._last(side)
            since_s = beat_s - last.arrive_s
            if since_s < 0.27:
                continue
            far = off_neutral_share(last.pose)
            held = manner.relaxed_towards_centre(
                last.pose, min((0.15 + 0.45 * far) * since_s, 0.45)
            )
            up, down = manner.beat_poses(held, depth_m, float(aside_m))
            lift_s = beat_s - 0.16
            self._add(side, lift_s, min(0.34, lift_s - last.arrive_s + 0.16), up, "beat", name)
            self._add(side, beat_s + 0.03, rng.uniform(0.25, 0.33), down, "beat", name)

    def _hold(self, side: str, name: str, end_s: float) -> None:
        """Plan a hold that relaxes, sooner where the hand is high or wide."""
        rng = self.rng
        while end_s + 0.3 - self._last(side).arrive_s > 0.6:
            pose = self._last(side).pose
            far = off_neutral_share(pose)
            held = self.manner.relaxed_towards_centre(pose, rng.uniform(0.15, 0.3) + 0.3 * far)
            arrive_s = self._last(side).arrive_s + rng.uniform(0.55, 0.8) - 0.1 * far
            self._add(side, arrive_s, rng.uniform(0.5, 0.75), held, "hold", name)

    def _idle(self, side: str, apex_s: float, beats: list[tuple[float, float]]) -> None:
        """Plan the idle hand, which moves to its waiting pose and follows the beats a little."""
        rng, speaker = self.rng, self.speaker
        pose = self.manner.rest_pose(speaker.waiting_of(side, rng.random()))
        away_m = float(np.linalg.norm(pose.position - self._last(side).pose.position))
        if away_m > 0.06 and rng.random() < 0.85:
            pose = replace(pose, fingers=self.manner.idle_fingers())
            arrive_s = max(apex_s + rng.uniform(0.1, 0.6), self._last(side).arrive_s + 0.35)
            self._add(side, arrive_s, rng.uniform(0.6, 0.95), pose, "retraction", "")
        for beat_s, depth_m in [(apex_s, 0.08), *beats]:
            if beat_s - self._last(side).arrive_s < 0.35 or rng.random() > 0.85:
                continue
            pose = self._last(side).pose
            rise = depth_m * rng.uniform(0.4, 0.7)
            up = replace(
                pose,
                position=pose.position + rise * np.array([0.4, 1.0, 0.3]),
                flex_deg=pose.flex_deg - 5.0,
            )
            fingers = pose.fingers.copy()
            fingers[FLEX] += np.repeat(rng.normal(0, 5.0, 4), 3)
            down = replace(pose, position=pose.position + rng.normal(0, 0.008, 3), fingers=fingers)
            self._add(side, beat_s - 0.14, 0.32, up, "beat", "follow")
            self._add(side, beat_s + 0.06, 0.34, down, "beat", "follow")


def _moved(pose: HandPose, out_m: float) -> HandPose:
    return replace(pose, position=pose.position + np.array([out_m, 0.0, 0.0]))
