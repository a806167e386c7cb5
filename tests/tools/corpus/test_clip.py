"""A clip moves like a person: alive, at human speeds, hands out of the body, feet still."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from conventions.joints import JOINT_INDEX
from conventions.rates import FPS
from tools.corpus.body.arms import follow_plan, move_arms
from tools.corpus.body.contact import Hips
from tools.corpus.clip import Clip, make_clip
from tools.corpus.gesture.gestures import REST
from tools.corpus.gesture.plan import Key, Plan
from tools.corpus.people.rig import forward_kinematics, matrices, open_body_rig
from tools.corpus.people.speaker import SPEAKERS, Speaker

from .conftest import CALM, LIVELY


def kinematics(clip: Clip) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    local = matrices(clip.poses.astype(np.float64).reshape(-1, 55, 3))
    return local, *forward_kinematics(open_body_rig(), local, clip.trans.astype(np.float64))


def speed_deg_s(rotmat: np.ndarray) -> np.ndarray:
    step = np.swapaxes(rotmat[:-1], -1, -2) @ rotmat[1:]
    angle = Rotation.from_matrix(step.reshape(-1, 3, 3)).magnitude()
    return np.degrees(angle).reshape(step.shape[:-2]) * FPS


@pytest.fixture(params=[LIVELY, CALM, "gus"])
def clip(request: pytest.FixtureRequest, clips: dict[str, Clip]) -> Clip:
    return clips[request.param]


def test_arrays_have_beat2_shapes_and_ranges(clip: Clip) -> None:
    num_frames = round(clip.utterance.duration_s * FPS)
    assert 24 * FPS < num_frames < 40 * FPS
    assert clip.poses.shape == (num_frames, 165)
    assert clip.trans.shape == (num_frames, 3)
    assert clip.expressions.shape == (num_frames, 100)
    for array in (clip.poses, clip.trans, clip.expressions):
        assert array.dtype == np.float32
        assert np.isfinite(array).all()
    assert clip.expressions.min() >= 0
    assert clip.expressions.max() <= 1
    assert not clip.expressions[:, 52:].any()
    names = open_body_rig().expression_names
    assert not clip.expressions[:, names.index("tongueOut")].any()
    assert clip.expressions[:, names.index("eyeBlinkLeft")].max() > 0.8


def test_no_joint_moves_faster_than_people_do(clip: Clip) -> None:
    local, global_rot, _ = kinematics(clip)
    speed = speed_deg_s(local)
    assert speed.max() < 900
    assert np.percentile(speed[:, [16, 17]], 99) < 150
    assert np.percentile(speed[:, [18, 19]], 99) < 350
    assert np.percentile(speed[:, 25:], 99) < 350
    assert speed_deg_s(global_rot[:, [9, 15]]).max() < 160


@pytest.mark.parametrize("speaker", SPEAKERS, ids=lambda speaker: speaker.name)
def test_no_wrist_is_thrown_off_its_way_from_one_frame_to_the_next(
    speaker: Speaker, flite: None
) -> None:
    """Against the step before; in recordings by 2.5 cm at most."""
    for seed in range(2):
        clip = make_clip(open_body_rig(), speaker, "train", 25.0, [19, seed])
        _, _, positions = kinematics(clip)
        wrists = positions[:, [JOINT_INDEX["left_wrist"], JOINT_INDEX["right_wrist"]]]
        assert np.linalg.norm(np.diff(wrists, 2, axis=0), axis=-1).max() < 0.025
        assert np.linalg.norm(np.diff(wrists, axis=0), axis=-1).max() < 0.08


def test_fingers_are_alive_and_bend_off_their_hinge(clip: Clip) -> None:
    local, _, _ = kinematics(clip)
    fingers = [
        j for name, j in JOINT_INDEX.items() if name[:-1].endswith(("index", "middle", "ring"))
    ]
    assert 30 < speed_deg_s(local[:, fingers]).mean() < 70
    poses = np.degrees(clip.poses.reshape(-1, 55, 3))
    knuckle = poses[:, JOINT_INDEX["right_index2"]]
    assert knuckle[:, 2].std() > 4  # the hinge
    assert knuckle[:, 0].std() > 1  # its own axis


def test_a_lively_fingertip_is_as_rough_as_a_persons_and_never_snaps(
    clips: dict[str, Clip],
) -> None:
    _, global_rot, positions = kinematics(clips[LIVELY])
    rig, last = open_body_rig(), JOINT_INDEX["right_middle3"]
    tip = positions[:, last] + global_rot[:, last] @ rig.tip_offsets[rig.tip_joints.index(last)]
    jerk = np.linalg.norm(np.diff(tip, 3, axis=0), axis=1) * FPS**3
    assert 90 < jerk.mean() < 180
    assert jerk.max() < 2000


def test_the_lively_speaker_moves_more_than_the_calm_one(clips: dict[str, Clip]) -> None:
    def wrist_speed(clip: Clip) -> float:
        _, _, positions = kinematics(clip)
        return float(np.linalg.norm(np.diff(positions[:, [20, 21]], axis=0), axis=-1).mean() * FPS)

    assert wrist_speed(clips[LIVELY]) > 1.4 * wrist_speed(clips[CALM])


def test_planted_feet_stay_and_stand_on_the_floor(clip: Clip) -> None:
    _, _, positions = kinematics(clip)
    rig = open_body_rig()
    for ankle in (JOINT_INDEX["left_ankle"], JOINT_INDEX["right_ankle"]):
        height = positions[:-1, ankle, 1] - (rig.rest_joints[ankle, 1] - rig.floor_m)
        assert height.min() > -1e-4
        planted = height < 1e-4
        slip = np.linalg.norm(np.diff(positions[:, ankle][:, [0, 2]], axis=0), axis=1) * FPS
        assert planted.mean() > 0.5
        assert slip[planted].mean() < 0.005
    lowest = positions[:, [10, 11], 1].min()
    assert -0.01 < lowest < 0.05


def test_knees_are_nearly_straight_and_never_pop(clip: Clip) -> None:
    local, _, _ = kinematics(clip)
    knees = local[:, [JOINT_INDEX["left_knee"], JOINT_INDEX["right_knee"]]]
    bend = np.degrees(Rotation.from_matrix(knees.reshape(-1, 3, 3)).magnitude())
    assert 8 < np.median(bend) < 16
    assert bend.min() > 4
    assert np.percentile(bend, 98) < 45
    speed = speed_deg_s(knees)
    assert np.percentile(speed, 99) < 220
    assert speed.max() < 400


HANDS = {"left": [20, *range(25, 40)], "right": [21, *range(40, 55)]}
# joint, lowest and highest point of a box well inside the open body, metres in the joint's frame
BOXES = (
    ("spine3", (-0.12, -0.20, -0.02), (0.12, 0.12, 0.14)),
    ("pelvis", (-0.13, -0.15, -0.06), (0.13, 0.10, 0.12)),
    ("pelvis", (-0.20, -0.30, -0.06), (0.20, -0.15, 0.10)),
)


def in_frame(points: np.ndarray, rotmat: np.ndarray, origin: np.ndarray) -> np.ndarray:
    return np.einsum("tij,tpi->tpj", rotmat, points - origin[:, None])


@pytest.mark.parametrize("side", HANDS)
def test_hands_stay_out_of_the_body(clip: Clip, side: str) -> None:
    _, global_rot, positions = kinematics(clip)
    inside = np.zeros(len(positions), dtype=bool)
    for name, lowest, highest in BOXES:
        joint = JOINT_INDEX[name]
        hand = in_frame(positions[:, HANDS[side]], global_rot[:, joint], positions[:, joint])
        inside |= np.any(((hand > lowest) & (hand < highest)).all(axis=-1), axis=-1)
    assert inside.mean() < 0.005


def test_hands_do_not_pass_through_each_other(clip: Clip) -> None:
    _, global_rot, positions = kinematics(clip)
    left, right = (
        in_frame(positions[:, HANDS[side]], global_rot[:, 9], positions[:, 9]) for side in HANDS
    )
    gaps = np.linalg.norm(left[:, :, None] - right[:, None], axis=-1)
    assert (gaps.min(axis=(1, 2)) > 0.012).mean() > 0.995
    assert (left.mean(axis=1)[:, 0] > right.mean(axis=1)[:, 0]).mean() > 0.98  # seldom crossed


def test_folded_hands_touch() -> None:
    rig = open_body_rig()
    speaker = next(s for s in SPEAKERS if s.rest == "clasp")
    rng = np.random.default_rng(0)
    keys = {side: [Key(-1.0, 0.5, REST["clasp"], "rest", "")] for side in ("left", "right")}
    curves = follow_plan(rig, Plan(keys), np.zeros(60), speaker, rng)
    still = Hips(np.tile(np.eye(3), (60, 1, 1)), np.tile([0.0, -0.35, 0.0], (60, 1)))
    rotations = move_arms(rig, Plan(keys), curves, still, np.zeros(60), speaker, rng)
    local = np.tile(np.eye(3), (60, 55, 1, 1))
    for joint, rotmat in rotations.items():
        local[:, joint] = rotmat
    _, positions = forward_kinematics(rig, local, np.zeros((60, 3)))
    left, right = (positions[:, HANDS[side]] for side in HANDS)
    gap = np.linalg.norm(left[:, :, None] - right[:, None], axis=-1).min(axis=(1, 2))
    # Bones of fingers that touch lie some 2 cm apart.
    assert np.median(gap) < 0.045
    assert np.percentile(gap, 2) > 0.012


def test_wrists_never_bend_beyond_their_range(clip: Clip) -> None:
    poses = np.degrees(np.linalg.norm(clip.poses.reshape(-1, 55, 3), axis=-1))
    assert poses[:, [20, 21]].max() < 95
    assert poses[:, [18, 19]].max() < 150


def test_strokes_end_on_stressed_vowels(clip: Clip) -> None:
    beats = np.array([w.beat_s for w in clip.utterance.words])
    strokes = [
        key.arrive_s
        for keys in clip.plan.keys.values()
        for key in keys
        if key.phase == "stroke" and 0 < key.arrive_s < clip.utterance.duration_s
    ]
    assert len(strokes) > 8
    late = np.array([t - beats[np.abs(beats - t).argmin()] for t in strokes])
    assert abs(np.median(late)) < 0.06
    assert np.percentile(np.abs(late), 80) < 0.16


def test_keys_of_a_hand_follow_each_other(clip: Clip) -> None:
    for keys in clip.plan.keys.values():
        times = [key.arrive_s for key in keys]
        assert all(a < b for a, b in pairwise(times))
        assert all(key.duration_s > 0.1 for key in keys)


def test_the_jaw_opens_in_vowels_and_lips_close_in_bilabials(clip: Clip) -> None:
    jaw = np.degrees(clip.poses.reshape(-1, 55, 3)[:, JOINT_INDEX["jaw"], 0])
    assert jaw.min() >= 0
    assert jaw.max() < 14

    def mean_jaw(names: set[str]) -> float:
        frames = [
            int(FPS * 0.5 * (p.start_s + p.end_s)) for p in clip.utterance.phones if p.name in names
        ]
        return float(jaw[frames].mean())

    assert mean_jaw({"aa", "ao", "ae", "ay", "aw"}) > 2 * mean_jaw({"p", "b", "m"})
    assert mean_jaw({"p", "b", "m"}) < 3.0
