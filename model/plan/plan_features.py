"""Gesture plans per frame: as tracks for a network, and as event chains that are sampled.

A hand has ten tracks: the path of its goals (out, up, forward), a pulse at the end of a phase, and
the phase; the rest of the body has nine.

Each tier is a chain of states; each begins at a frame with a mark (goal of a hand, depth of a nod).
A phase of a hand is a state; a nod, a blink or a gaze begins and lasts until the next. So a plan is
sampled frame by frame: stay in the state, or begin one.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.ndimage import gaussian_filter1d

from conventions.rates import FPS
from model.plan.plan import (
    PHASES,
    SIDES,
    STILL_PHASES,
    Blink,
    Brow,
    FootContact,
    Gaze,
    GesturePlan,
    HandPhase,
    Nod,
    Side,
    Smile,
    Stance,
    fill_gaps,
)

HAND_NUMBERS = 4 + len(PHASES)
BODY_TRACKS = ("nod", "yaw", "pitch", "brow", "smile", "blink", "stand", "left foot", "right foot")
NUM_TRACKS = 2 * HAND_NUMBERS + len(BODY_TRACKS)
HEAD_FACE_TRACKS = slice(2 * HAND_NUMBERS, 2 * HAND_NUMBERS + BODY_TRACKS.index("blink") + 1)
"""Tracks of the head and face: nods, gaze, brows, smiles and blinks."""
NUM_HEAD_FACE_TRACKS = HEAD_FACE_TRACKS.stop - HEAD_FACE_TRACKS.start
_GOAL, _END, _PHASE = slice(0, 3), 3, slice(4, 4 + len(PHASES))

GAUSSIAN_STD_FRAMES = 1.5
"""Standard deviation of the pulse at a phase's end, and of the smoothing of phases (frames)."""
NOD_S, BROW_S, BLINK_S = 0.1, 0.15, 0.05
"""Standard deviations of the pulses of a nod, a brow's rise and a blink (s)."""
NOD_DEG, LOOK_DEG = 5.0, 10.0
"""Angles that a track value of 1 stands for (degrees)."""
GLANCE_S = 0.09
"""Duration of a gaze shift (s)."""


def hand_tracks(side: Side) -> slice:
    """Return the columns of one hand."""
    first = SIDES.index(side) * HAND_NUMBERS
    return slice(first, first + HAND_NUMBERS)


def body_track(name: str) -> int:
    """Return the column of one of `BODY_TRACKS`."""
    return 2 * HAND_NUMBERS + BODY_TRACKS.index(name)


def plan_tracks(plan: GesturePlan, num_frames: int) -> Float[np.ndarray, "T tracks"]:
    """Convert a plan to tracks; frame k stands for the time (k + .5) / 30 s."""
    time_s = (np.arange(num_frames) + 0.5) / FPS
    tracks = np.zeros((num_frames, NUM_TRACKS), np.float32)
    for side in SIDES:
        phases = fill_gaps(plan.hand(side), num_frames / FPS)
        tracks[:, hand_tracks(side)] = _of_hand(phases, time_s)

    def pulses(name: str, times: Sequence[tuple[float, float]], deviation_s: float) -> None:
        for at_s, size in times:
            tracks[:, body_track(name)] += size * _bell((time_s - at_s) / deviation_s)

    pulses("nod", [(nod.time_s, nod.depth_deg / NOD_DEG) for nod in plan.nods], NOD_S)
    pulses("brow", [(brow.time_s, brow.height) for brow in plan.brows], BROW_S)
    pulses("blink", [(blink.time_s, 1.0) for blink in plan.blinks], BLINK_S)
    for before, look in pairwise((Gaze(-1.0, 0.0, 0.0, 0.0), *plan.looks)):
        share = _min_jerk((time_s - look.start_s) / GLANCE_S)
        tracks[:, body_track("yaw")] += share * (look.yaw_deg - before.yaw_deg) / LOOK_DEG
        tracks[:, body_track("pitch")] += share * (look.pitch_deg - before.pitch_deg) / LOOK_DEG
    for smile in plan.smiles:
        tracks[:, body_track("smile")] += smile.size * _while(smile, time_s)
    for stand in plan.stands:
        sign = {"left": 1.0, "right": -1.0, "both": 0.0}[stand.leg]
        tracks[:, body_track("stand")] += sign * _while(stand, time_s)
    for one in plan.planted:
        tracks[:, body_track(f"{one.foot} foot")] += _while(one, time_s)
    for name, frames in (("smile", 6), ("stand", 6), ("left foot", 1), ("right foot", 1)):
        column = tracks[:, body_track(name)]
        tracks[:, body_track(name)] = gaussian_filter1d(column, frames)
    return tracks


def both_hands_rest_weight(plan: GesturePlan, frames: range) -> Float[np.ndarray, " T"]:
    """Compute the smoothed mask (0 to 1) of frames in which both hands rest; ends are repeated."""
    margin = round(4 * GAUSSIAN_STD_FRAMES)
    wide = range(frames.start - margin, frames.stop + margin)
    time_s = ((np.array(wide) + 0.5) / FPS).clip(0.5 / FPS, plan.duration_s - 0.5 / FPS)
    rests = np.ones(len(wide), bool)
    for side in SIDES:
        hand = np.zeros(len(wide), bool)
        for phase in fill_gaps(plan.hand(side), plan.duration_s):
            if phase.phase == "rest":
                hand |= (phase.start_s <= time_s) & (time_s < phase.end_s)
        rests &= hand
    soft = gaussian_filter1d(rests.astype(float), GAUSSIAN_STD_FRAMES)
    return soft[margin : margin + len(frames)]


def goal_path(
    phases: Sequence[HandPhase], time_s: Float[np.ndarray, " T"]
) -> Float[np.ndarray, "T 3"]:
    """Interpolate goals by minimum jerk within phases (at least one, without gaps)."""
    goals = np.array([phase.goal for phase in phases])
    path = np.tile(goals[0], (len(time_s), 1))
    for before, goal, phase in zip(goals[:-1], goals[1:], phases[1:], strict=True):
        since = time_s >= phase.start_s
        share = _min_jerk((time_s[since] - phase.start_s) / (phase.end_s - phase.start_s))
        path[since] = before + share[:, None] * (goal - before)
    return path


def _of_hand(
    phases: tuple[HandPhase, ...], time_s: Float[np.ndarray, " T"]
) -> Float[np.ndarray, "T numbers"]:
    numbers = np.zeros((len(time_s), HAND_NUMBERS))
    numbers[:, _GOAL] = goal_path(phases, time_s)
    for phase in phases:
        if phase.phase not in STILL_PHASES:
            since = (time_s - phase.end_s) * FPS / GAUSSIAN_STD_FRAMES
            numbers[:, _END] = np.maximum(numbers[:, _END], _bell(since))
        numbers[:, _PHASE.start + PHASES.index(phase.phase)] += _while(phase, time_s)
    numbers[:, _PHASE] = gaussian_filter1d(numbers[:, _PHASE], GAUSSIAN_STD_FRAMES, axis=0)
    return numbers


def _bell(x: Float[np.ndarray, " T"]) -> Float[np.ndarray, " T"]:
    return np.exp(-0.5 * x**2)


def _min_jerk(share: Float[np.ndarray, " T"]) -> Float[np.ndarray, " T"]:
    s = np.clip(share, 0.0, 1.0)
    return s**3 * (10 - 15 * s + 6 * s**2)


def _while(
    event: HandPhase | Smile | Stance | FootContact, time_s: Float[np.ndarray, " T"]
) -> Bool[np.ndarray, " T"]:
    """Return a mask (T,) of frames with their centre in an event."""
    return (time_s >= event.start_s) & (time_s < event.end_s)


@dataclass(frozen=True)
class EventTier:
    """Kind of event chain: its name, states and the scales of its marks."""

    name: str
    states: tuple[str, ...]
    mark_scales: tuple[float, ...] = ()
    """Scale of each value of a mark."""
    coupled_tier: str = ""
    """Name of the coupled tier. Tiers are sampled in order: a later one is known up to the frame
    before, an earlier one up to this frame."""

    @property
    def state_feature_dim(self) -> int:
        """Length of a state's features: one-hot state, two durations, mark."""
        return len(self.states) + 2 + len(self.mark_scales)


_METRES = (0.2, 0.2, 0.2)
TIERS: tuple[EventTier, ...] = (
    EventTier("right", PHASES, _METRES, coupled_tier="left"),
    EventTier("left", PHASES, _METRES, coupled_tier="right"),
    EventTier("look", ("look",), (10.0, 5.0)),
    EventTier("nod", ("nod",), (4.0,)),
    EventTier("brow", ("brow",), (0.4,)),
    EventTier("blink", ("blink",)),
    EventTier("stand", ("both", "left", "right")),
    EventTier("left foot", ("step", "planted"), coupled_tier="right foot"),
    EventTier("right foot", ("step", "planted"), coupled_tier="left foot"),
    EventTier("smile", ("serious", "smile"), (0.3,)),
)
TIERS_BY_NAME = {tier.name: tier for tier in TIERS}
MAX_STATE_S = 8.0
"""Longest duration in the description of a state (s); longer ones are clipped."""


@dataclass(frozen=True)
class EventOnset:
    """A state that begins at a frame."""

    frame: int
    state: int
    mark: tuple[float, ...] = ()
    """Mark in the tier's scale."""


@dataclass(frozen=True)
class ChainStates:
    """Event chain of a tier at some frames."""

    features_before: Float[np.ndarray, "T state_feature_dim"]
    """Chain's state before the frame: one-hot state, its duration twice, mark."""
    features_after: Float[np.ndarray, "T state_feature_dim"]
    """Chain's state after the event of the frame."""
    event: Int[np.ndarray, " T"]
    """Event (T,): 0 to stay, or 1 + the state that begins."""
    mark: Float[np.ndarray, "T mark_dim"]
    """Mark (T, mark_dim) of the state that begins."""


def plan_to_chains(plan: GesturePlan) -> dict[str, list[EventOnset]]:
    """Convert a plan to event chains by tier; frame 0 has the initial state of each."""
    end_s = plan.duration_s
    chains: dict[str, list[EventOnset]] = {}

    def add(name: str, start_s: float, state: str, mark: Sequence[float] = ()) -> None:
        tier = TIERS_BY_NAME[name]
        scaled = tuple(float(m / scale) for m, scale in zip(mark, tier.mark_scales, strict=True))
        begun = EventOnset(max(0, round(start_s * FPS)), tier.states.index(state), scaled)
        chain = chains.setdefault(name, [])
        if chain and chain[-1].frame >= begun.frame:
            chain.pop()
        chain.append(begun)

    for side in SIDES:
        for phase in fill_gaps(plan.hand(side), end_s):
            add(side, phase.start_s, phase.phase, phase.goal)
        add(f"{side} foot", 0.0, "step")
        for one in plan.planted:
            if one.foot == side:
                add(f"{side} foot", one.start_s, "planted")
                if one.end_s < end_s - 0.5 / FPS:
                    add(f"{side} foot", one.end_s, "step")
    for name, begins in (
        ("look", [(look.start_s, (look.yaw_deg, look.pitch_deg)) for look in plan.looks]),
        ("nod", [(nod.time_s, (nod.depth_deg,)) for nod in plan.nods]),
        ("brow", [(brow.time_s, (brow.height,)) for brow in plan.brows]),
        ("blink", [(blink.time_s, ()) for blink in plan.blinks]),
    ):
        add(name, 0.0, name, (0.0,) * len(TIERS_BY_NAME[name].mark_scales))
        for start_s, mark in begins:
            add(name, start_s, name, mark)
    add("smile", 0.0, "serious", (0.0,))
    for smile in plan.smiles:
        add("smile", smile.start_s, "smile", (smile.size,))
        if smile.end_s < end_s - 0.5 / FPS:
            add("smile", smile.end_s, "serious", (0.0,))
    add("stand", 0.0, "both")
    for stand in plan.stands:
        add("stand", stand.start_s, stand.leg)
    return chains


def chains_to_plan(chains: dict[str, list[EventOnset]], num_frames: int) -> GesturePlan:
    """Convert event chains to a plan without words and kinds; frame 0 has no events."""

    def spans(name: str) -> Iterator[tuple[EventOnset, float, float, tuple[float, ...]]]:
        """Yield each state with its start and end (s) and its mark."""
        chain, scales = chains[name], TIERS_BY_NAME[name].mark_scales
        for one, two in zip(chain, [*chain[1:], None], strict=True):
            stop = two.frame if two else num_frames
            if stop > one.frame:
                mark = tuple(m * scale for m, scale in zip(one.mark, scales, strict=True))
                yield one, one.frame / FPS, stop / FPS, mark

    def points(name: str) -> list[tuple[float, tuple[float, ...]]]:
        return [(start_s, mark) for one, start_s, _, mark in spans(name) if one.frame > 0]

    def in_state(name: str, state: str) -> list[tuple[float, float, tuple[float, ...]]]:
        number = TIERS_BY_NAME[name].states.index(state)
        return [(a, b, mark) for one, a, b, mark in spans(name) if one.state == number]

    left, right = (
        tuple(HandPhase(a, b, PHASES[one.state], _reachable(m)) for one, a, b, m in spans(side))
        for side in SIDES
    )
    stands = [Stance(a, b, leg) for leg in SIDES for a, b, _ in in_state("stand", leg)]
    return GesturePlan(
        num_frames / FPS,
        left,
        right,
        tuple(Nod(at, depth) for at, (depth,) in points("nod") if depth > 0),
        tuple(Gaze(a, b, *mark) for _, a, b, mark in spans("look")),
        tuple(Brow(at, float(np.clip(height, -1.0, 1.0))) for at, (height,) in points("brow")),
        tuple(
            Smile(a, b, float(np.clip(m[0], 0.0, 1.0))) for a, b, m in in_state("smile", "smile")
        ),
        tuple(Blink(at) for at, _ in points("blink")),
        tuple(sorted(stands, key=lambda stand: stand.start_s)),
        tuple(
            FootContact(a, b, side)
            for side in SIDES
            for a, b, _ in in_state(f"{side} foot", "planted")
        ),
    )


def chain_states(
    tier: EventTier, chain: Sequence[EventOnset], frames: Int[np.ndarray, " T"]
) -> ChainStates:
    """Describe a chain at some frames; the chain begins at frame 0."""
    first = np.array([begun.frame for begun in chain])
    states = np.array([begun.state for begun in chain])
    marks = np.array([begun.mark for begun in chain], float).reshape(len(chain), -1)
    now = np.searchsorted(first, frames, side="right") - 1
    before = np.maximum(np.searchsorted(first, frames, side="left") - 1, 0)
    begins = (now != before) & (frames > 0)
    return ChainStates(
        features_before=_state_features(
            tier, states[before], frames - first[before], marks[before]
        ),
        features_after=_state_features(tier, states[now], frames - first[now], marks[now]),
        event=np.where(begins, 1 + states[now], 0),
        mark=np.where(begins[:, None], marks[now], 0.0).astype(np.float32),
    )


def _state_features(
    tier: EventTier,
    states: Int[np.ndarray, " T"],
    lasted: Int[np.ndarray, " T"],
    marks: Float[np.ndarray, "T mark_dim"],
) -> Float[np.ndarray, "T state_feature_dim"]:
    seconds = np.minimum(lasted / FPS, MAX_STATE_S)
    which = np.eye(len(tier.states))[states]
    times = np.stack([seconds, np.log(seconds + 0.1)], axis=1)
    return np.concatenate([which, times, marks], axis=1).astype(np.float32)


def tier_sampling_inputs(chains: Mapping[str, ChainStates]) -> dict[str, Float[np.ndarray, "T _"]]:
    """Return the input of each tier's sampler: its own features, and the coupled tier's if any."""
    drawn: set[str] = set()
    states = {}
    for tier in TIERS:
        own = chains[tier.name].features_before
        if tier.coupled_tier:
            other = chains[tier.coupled_tier]
            now = other.features_after if tier.coupled_tier in drawn else other.features_before
            own = np.concatenate([own, now], axis=1)
        states[tier.name] = own
        drawn.add(tier.name)
    return states


def chain_state_at(
    tier: EventTier, onset: EventOnset, frame: int
) -> Float[np.ndarray, " state_feature_dim"]:
    """Describe a chain at one frame, as `_state_features` does for many; called at every frame."""
    seconds = min((frame - onset.frame) / FPS, MAX_STATE_S)
    count = len(tier.states)
    state = np.zeros(tier.state_feature_dim, np.float32)
    state[onset.state] = 1.0
    state[count : count + 2] = seconds, np.log(seconds + 0.1)
    state[count + 2 :] = onset.mark
    return state


def _reachable(goal: Sequence[float]) -> tuple[float, float, float]:
    out, up, forward = np.clip(goal, -0.99, 0.99).tolist()
    return out, up, forward
