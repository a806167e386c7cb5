"""One clip of one speaker from one seed, and its files in BEAT2's layout.

The files are motion, sound, annotation and the table of splits. Each is written atomically and
contains no time stamp, so that the same clip gives the same bytes. The annotation is a Praat
TextGrid of speech and body events in seconds. Nothing is measured in the motion: tiers contain the
events that the motion was made from.
"""

import io
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from jaxtyping import Float32

from conventions.joints import JOINT_INDEX, NUM_JOINTS
from conventions.rates import FPS
from model.plan.annotation_files import Interval, NamedTier, format_textgrid
from model.speech.audio import wav_bytes
from model.storage.files import write_atomically, write_error
from tools.corpus.body.arms import follow_plan, move_arms
from tools.corpus.body.contact import hips_in_chest
from tools.corpus.body.face import FaceCurves, move_face
from tools.corpus.body.legs import Legs, move_legs
from tools.corpus.body.signals import frame_times, listening_envelope
from tools.corpus.body.trunk import Trunk, move_trunk
from tools.corpus.gesture.plan import HandKey, HandPlan, make_plan
from tools.corpus.people.rig import SIDE_SIGN, SIDES, Rig, axis_angles
from tools.corpus.people.speaker import Speaker
from tools.corpus.words.grammar import Split
from tools.corpus.words.prosody import Utterance, synthesise_utterance

NUM_EXPRESSIONS = 100


@dataclass(frozen=True)
class CorpusClip:
    """Motion in BEAT2's arrays, with the speech and the body parts that it was made from."""

    poses: Float32[np.ndarray, "T 165"]
    trans: Float32[np.ndarray, "T 3"]
    expressions: Float32[np.ndarray, "T 100"]
    utterance: Utterance
    plan: HandPlan
    trunk: Trunk
    face: FaceCurves
    legs: Legs


def make_clip(
    rig: Rig, speaker: Speaker, split: Split, target_s: float, seed: list[int]
) -> CorpusClip:
    """Make a clip of about ``target_s`` seconds; deterministic in its arguments."""
    text_rng, voice_rng, motion_rng = np.random.default_rng(seed).spawn(3)
    utterance = synthesise_utterance(speaker, target_s, split, text_rng, voice_rng)
    return animate(rig, speaker, utterance, motion_rng)


def animate(
    rig: Rig, speaker: Speaker, utterance: Utterance, rng: np.random.Generator
) -> CorpusClip:
    """Animate gestures, body and face for an utterance; round(30 x seconds) frames."""
    plan_rng, arm_rng, trunk_rng, leg_rng, face_rng = rng.spawn(5)
    num_frames = round(utterance.duration_s * FPS)
    plan = make_plan(utterance, speaker, plan_rng)
    calm = listening_envelope(utterance, frame_times(num_frames))
    hands = follow_plan(rig, plan, calm, speaker, arm_rng)
    trunk = move_trunk(utterance, hands, calm, speaker, trunk_rng)
    arms = move_arms(rig, plan, hands, hips_in_chest(rig, trunk.rotations), calm, speaker, arm_rng)
    legs = move_legs(rig, trunk, calm, speaker, leg_rng)
    face = move_face(utterance, rig.expression_names, trunk, speaker, face_rng)
    rotations = arms | trunk.rotations | legs.rotations
    poses = np.zeros((num_frames, NUM_JOINTS, 3))
    for joint, rotmat in rotations.items():
        poses[:, joint] = axis_angles(rotmat)
    for side in SIDES:
        lift = np.radians(0.7 * trunk.breath) * SIDE_SIGN[side]
        poses[:, JOINT_INDEX[f"{side}_collar"], 2] += lift
    poses[:, JOINT_INDEX["jaw"], 0] = face.jaw
    expressions = np.zeros((num_frames, NUM_EXPRESSIONS), dtype=np.float32)
    expressions[:, : face.units.shape[1]] = face.units
    return CorpusClip(
        poses.reshape(num_frames, -1).astype(np.float32),
        legs.trans.astype(np.float32),
        expressions,
        utterance,
        plan,
        trunk,
        face,
        legs,
    )


MOTION, SOUND, TEXTGRID = "smplxflame_30", "wave16k", "textgrid"
SPLIT_TABLE = "train_test_split.csv"
EXPRESSION_BASIS = "arkit52"


@dataclass(frozen=True)
class ClipPaths:
    """Paths of the three files of a clip."""

    motion: Path
    sound: Path
    textgrid: Path

    def all_exist(self) -> bool:
        return all(path.is_file() for path in (self.motion, self.sound, self.textgrid))


def clip_paths(root: Path, clip_id: str) -> ClipPaths:
    """Return the paths of a clip's files under the corpus folder."""
    return ClipPaths(
        root / MOTION / f"{clip_id}.npz",
        root / SOUND / f"{clip_id}.wav",
        root / TEXTGRID / f"{clip_id}.TextGrid",
    )


def write_clip(root: Path, clip_id: str, clip: CorpusClip) -> None:
    """Write the files of a clip, its motion last."""
    paths = clip_paths(root, clip_id)
    write_bytes(paths.sound, wav_bytes(clip.utterance.waveform))
    write_bytes(paths.textgrid, textgrid(clip).encode())
    motion = io.BytesIO()
    np.savez(
        motion,
        poses=clip.poses,
        trans=clip.trans,
        expressions=clip.expressions,
        betas=np.zeros(300, dtype=np.float32),
        gender="neutral",
        model="smplx2020",
        mocap_frame_rate=np.array(FPS, dtype=np.int32),
        expression_basis=EXPRESSION_BASIS,
    )
    write_bytes(paths.motion, motion.getvalue())


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file atomically, in a new folder if needed; raises WriteError with the reason."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise write_error(path.parent, error) from error
    write_atomically(path, content)


def split_table(rows: list[tuple[str, str]]) -> str:
    """Format ``train_test_split.csv``: the id and split of every clip."""
    return "id,type\n" + "".join(f"{clip_id},{split}\n" for clip_id, split in rows)


Span = tuple[float, float, str]
Point = tuple[float, str]
NO_SMILE = 0.02  # levels up to this count as no smile


def textgrid(clip: CorpusClip) -> str:
    """Format a clip's tiers of speech, hands, head, face and feet in Praat's long format."""
    utterance, trunk, face = clip.utterance, clip.trunk, clip.face
    duration_s = utterance.duration_s

    def intervals(name: str, rows: list[Span]) -> NamedTier:
        merged: list[Interval] = []
        for row in rows:
            clipped = _clipped(row, merged[-1].end_s if merged else 0.0, duration_s)
            if clipped is not None:
                merged.append(Interval(*clipped))
        return NamedTier(name, tuple(merged))

    def moments(name: str, rows: list[Point]) -> NamedTier:
        return NamedTier(name, tuple(Interval(at, at, text) for at, text in rows), has_points=True)

    def points(name: str, rows: list[Point]) -> NamedTier:
        return moments(name, sorted(row for row in rows if 0 <= row[0] < duration_s))

    moves = {side: gesture_intervals_and_goals(clip.plan.keys[side], duration_s) for side in SIDES}
    tiers = [
        intervals("words", [(w.start_s, w.end_s, w.text) for w in utterance.words]),
        intervals("phones", [(p.start_s, p.end_s, p.name) for p in utterance.phones]),
        points("accents", [(w.beat_s, f"{w.accent:.3f}") for w in utterance.words if w.accent > 0]),
        *(intervals(f"gesture_{side}", moves[side][0]) for side in SIDES),
        *(moments(f"goal_{side}", moves[side][1]) for side in SIDES),
        points("apex", [apex for side in SIDES for apex in _apexes(clip.plan.keys[side], side)]),
        points("nods", [(nod.time_s, f"{nod.depth_deg:.3f}") for nod in trunk.nods]),
        intervals(
            "gaze", [(g.start_s, g.end_s, f"{g.yaw_deg:.1f} {g.pitch_deg:.1f}") for g in trunk.gaze]
        ),
        points("brows", [(b.time_s, f"{b.height:.3f} {b.width_s:.3f}") for b in face.brows]),
        intervals(
            "smile",
            [(s.start_s, s.end_s, f"{s.size:.3f}") for s in face.smiles if s.size > NO_SMILE],
        ),
        points("blinks", [(b.time_s, f"{b.duration_s:.3f}") for b in face.blinks]),
        intervals("weight", [(s.start_s, s.end_s, s.leg) for s in clip.legs.stances]),
        *(
            intervals(
                f"foot_{side}",
                [(p.start_s, p.end_s, "planted") for p in clip.legs.planted if p.foot == side],
            )
            for side in SIDES
        ),
        intervals("listening", [(s.start_s, s.end_s, "listening") for s in utterance.listening]),
    ]
    return format_textgrid(tiers, round(duration_s, 4))


def gesture_intervals_and_goals(
    keys: list[HandKey], duration_s: float
) -> tuple[list[Span], list[Point]]:
    """Return the gesture intervals of a hand, and its goal position at the end of each move.

    An interval is labelled ``stroke offer``: Kendon's phase, then the gesture's name if there is
    one; holds or rests lie between the moves. A goal is ``out up forward`` in metres in the chest's
    frame; the first, at 0, is the initial pose of the clip.
    """
    started = [key for key in keys if key.arrive_s <= 0]
    rows: list[tuple[Span, HandKey | None]] = []
    for before, key in pairwise([started[-1], *(key for key in keys if key.arrive_s > 0)]):
        start_s = max(key.arrive_s - key.duration_s, before.arrive_s)
        rows.append(((before.arrive_s, start_s, _stillness(before)), None))
        rows.append(((start_s, key.arrive_s, f"{key.phase} {key.gesture}".strip()), key))
    rows.append(((keys[-1].arrive_s, duration_s, _stillness(keys[-1])), None))
    intervals: list[Span] = []
    goals = [(0.0, _goal(started[-1]))]
    for row, key in rows:
        clipped = _clipped(row, intervals[-1][1] if intervals else 0.0, duration_s)
        if clipped is not None:
            intervals.append(clipped)
            if key is not None:
                goals.append((clipped[1], _goal(key)))
    return intervals, goals


def _stillness(key: HandKey) -> str:
    still = "rest" if key.phase in ("rest", "retraction") else "hold"
    return f"{still} {key.gesture}".strip()


def _goal(key: HandKey) -> str:
    return " ".join(f"{metres:.3f}" for metres in key.pose.position)


def _apexes(keys: list[HandKey], side: str) -> list[Point]:
    """Return the ends of strokes with gesture, hand and word."""
    return [
        (key.arrive_s, f"{key.gesture} {side} {key.word}".strip())
        for key in keys
        if key.phase == "stroke" and key.arrive_s > 0
    ]


def _clipped(row: Span, from_s: float, duration_s: float) -> Span | None:
    """Clip an interval to ``from_s`` and the clip's end, rounded to a tenth of a millisecond."""
    start_s, end_s = max(round(row[0], 4), from_s), min(round(row[1], 4), round(duration_s, 4))
    return (start_s, end_s, row[2]) if end_s > start_s else None
