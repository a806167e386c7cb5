"""One clip put together: speech, plan and motion for one speaker from one seed."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32

from conventions.joints import JOINT_INDEX, NUM_JOINTS
from conventions.rates import FPS
from tools.corpus.body.arms import follow_plan, move_arms
from tools.corpus.body.contact import hips_of
from tools.corpus.body.face import move_face
from tools.corpus.body.legs import move_legs
from tools.corpus.body.signals import BodyEvents, frame_times, quiet
from tools.corpus.body.trunk import move_trunk
from tools.corpus.gesture.plan import HandPlan, make_plan
from tools.corpus.people.rig import SIDE_SIGN, SIDES, Rig, axis_angles
from tools.corpus.people.speaker import Speaker
from tools.corpus.words.grammar import Split
from tools.corpus.words.prosody import Utterance, speak

NUM_EXPRESSIONS = 100


@dataclass(frozen=True)
class CorpusClip:
    """Motion in BEAT2's arrays, with the speech, the plan and the events it was made from."""

    poses: Float32[np.ndarray, "T 165"]
    trans: Float32[np.ndarray, "T 3"]
    expressions: Float32[np.ndarray, "T 100"]
    utterance: Utterance
    plan: HandPlan
    events: BodyEvents


def make_clip(
    rig: Rig, speaker: Speaker, split: Split, target_s: float, seed: list[int]
) -> CorpusClip:
    """A clip of about ``target_s`` seconds; the same arguments give the same clip."""
    text_rng, voice_rng, motion_rng = np.random.default_rng(seed).spawn(3)
    utterance = speak(speaker, target_s, split, text_rng, voice_rng)
    return animate(rig, speaker, utterance, motion_rng)


def animate(
    rig: Rig, speaker: Speaker, utterance: Utterance, rng: np.random.Generator
) -> CorpusClip:
    """Gestures, body and face to given speech; round(30 x seconds) frames."""
    plan_rng, arm_rng, trunk_rng, leg_rng, face_rng = rng.spawn(5)
    num_frames = round(utterance.duration_s * FPS)
    plan = make_plan(utterance, speaker, plan_rng)
    calm = quiet(utterance, frame_times(num_frames))
    hands = follow_plan(rig, plan, calm, speaker, arm_rng)
    trunk = move_trunk(utterance, hands, calm, speaker, trunk_rng)
    arms = move_arms(rig, plan, hands, hips_of(rig, trunk.rotations), calm, speaker, arm_rng)
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
        BodyEvents(
            *(trunk.nods, trunk.gaze, face.brows, face.smiles, face.blinks),
            *(legs.stances, legs.steps),
        ),
    )
