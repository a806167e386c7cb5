"""Written files move in three.js, a viewer that is not ours, as they do here."""

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from conventions.joints import JOINT_INDEX, JOINT_NAMES, PARENTS
from renderer.body.body import Body, load_body
from renderer.body.character import rest_to_zero_pose_rotations
from renderer.body.gltf import Gltf
from renderer.files.character_glb import character_glb_bytes
from renderer.files.vrma import _t_pose, vrma_bytes
from tests.renderer.body.made_character import character, degrees_apart, lively
from tests.renderer.body.test_character import RPM

pytestmark = pytest.mark.slow

PLAYER = Path(__file__).parents[3] / "tests" / "javascript" / "three"
FRAMES = (0, 7, 20, 29)
MAX_DISTANCE_M, MAX_ANGLE_DEG = 0.001, 0.5


@pytest.fixture(scope="session")
def three() -> None:
    """Install three.js, if that is possible here."""
    if not (shutil.which("node") and shutil.which("npm")):
        pytest.skip("Node.js and npm are not installed.")
    if not (PLAYER / "node_modules").is_dir():
        install = ["npm", "ci", "--ignore-scripts", "--no-audit", "--no-fund", "--fetch-retries=1"]
        done = subprocess.run(install, check=False, cwd=PLAYER, capture_output=True, text=True)
        if done.returncode:
            pytest.skip(f"three.js cannot be installed: {done.stderr[-200:]}")


def played(*paths: Path) -> tuple[dict[int, np.ndarray], list[dict]]:
    """Play a file in three.js; return the matrices (T, 4, 4) of each node, and all moments."""
    times = json.dumps([frame / 30 for frame in FRAMES])
    command = ["node", str(PLAYER / "player.js"), times, *map(str, paths)]
    answer = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)
    moments = answer["moments"]
    nodes = {
        int(node): np.array([each["matrices"][node] for each in moments])
        for node in moments[0]["matrices"]
    }
    return {node: each.reshape(-1, 4, 4).mT for node, each in nodes.items()}, moments


def turns_of(matrices: np.ndarray) -> np.ndarray:
    return matrices[..., :3, :3] / np.linalg.norm(matrices[..., :3, :3], axis=-2, keepdims=True)


@pytest.mark.parametrize("kind", ["mixamo", "vrm", "vrm0", "ready player me"])
def test_characters_own_file(three: None, kind: str, tmp_path: Path) -> None:
    hero, moves = tmp_path / "hero.vrm", tmp_path / "moves.glb"
    if kind == "ready player me":
        if not RPM.is_file():
            pytest.skip(f"There is no research character at {RPM}.")
        shutil.copy(RPM, hero)
    else:
        hero.write_bytes(character(load_body(), kind))
    body, motion = load_body(hero), lively(30)
    moves.write_bytes(character_glb_bytes(body, motion))
    nodes, moments = played(moves)
    rest = Gltf(hero.read_bytes(), "hero").world
    rig = body.rig
    assert rig is not None
    expected = body.joint_positions(motion)[list(FRAMES)]
    world = body.global_transforms_without_trans(motion)[0][list(FRAMES)]
    assert sum(node >= 0 for node in rig.joint_nodes) > 50
    for joint, node in enumerate(rig.joint_nodes):
        if node < 0:
            continue
        places = rig.file_to_body_scale * nodes[node][:, :3, 3] @ rig.R_file_to_body.T
        assert np.linalg.norm(places - expected[:, joint], axis=1).max() < MAX_DISTANCE_M
        turned = (
            rig.R_file_to_body
            @ turns_of(nodes[node])
            @ turns_of(rest[node]).T
            @ rig.R_file_to_body.T
        )
        assert (
            degrees_apart(turned @ rig.R_rest_to_zero_pose[joint].T, world[:, joint])
            < MAX_ANGLE_DEG
        )
    opened = body.expression_weights(motion, slice(0, 30))[list(FRAMES), 24]
    shown = np.array([moment["weights"][0] for moment in moments])
    assert (np.abs(shown - opened[:, None]).max(axis=0) < 1e-3).any(), "jawOpen"


def t_posed(body: Body) -> np.ndarray:
    """Return local rotations (55, 3) of the T-pose of VRM."""
    rest, ground = body.rest_joints.astype(np.float64), float(body.template[:, 1].min())
    pose = dict(zip(JOINT_NAMES, _t_pose(rest, ground), strict=True))
    world = [turn.inv() for turn in rest_to_zero_pose_rotations(pose, {}, rest, {})]
    return np.array(
        [
            (world[max(PARENTS[joint], 0)].inv() * turn if joint else turn).as_rotvec()
            for joint, turn in enumerate(world)
        ]
    )


def test_vrma_on_a_vrm_character(three: None, tmp_path: Path) -> None:
    body, motion = load_body(), lively(30)
    hero, moves = tmp_path / "hero.vrm", tmp_path / "moves.vrma"
    hero.write_bytes(character(body, "vrm", scale=1.0, rest_pose=t_posed(body)))
    moves.write_bytes(vrma_bytes(body, motion))
    nodes, moments = played(hero, moves)
    bones = Gltf(hero.read_bytes(), "hero").document["extensions"]["VRMC_vrm"]["humanoid"]
    named = {f"J_{number}": number for number in range(55)}
    file = Gltf(hero.read_bytes(), "hero")
    joint_of = {
        each["node"]: named[file.nodes[each["node"]]["name"]]
        for bone, each in bones["humanBones"].items()
        if bone not in ("jaw", "leftEye", "rightEye")
    }
    assert len(joint_of) == 52
    expected = body.joint_positions(motion)[list(FRAMES)]
    hips = next(node for node, joint in joint_of.items() if joint == 0)
    for node, joint in joint_of.items():
        places = nodes[node][:, :3, 3] - nodes[hips][:, :3, 3]
        apart = places - (expected[:, joint] - expected[:, 0])
        assert np.linalg.norm(apart, axis=1).max() < MAX_DISTANCE_M, JOINT_NAMES[joint]
    # The hips are as high above the floor, which is at another height in this file.
    scale = file.world[hips][1, 3] / _t_pose(body.rest_joints.astype(float), -1.3024229)[0, 1]
    assert np.abs(nodes[hips][:, :3, 3] - scale * expected[:, 0]).max() < MAX_DISTANCE_M
    jaw = motion.poses[list(FRAMES), 3 * JOINT_INDEX["jaw"]] / 0.4
    opened = (motion.expressions[list(FRAMES), 24] + jaw.clip(0, 1)).clip(0, 1)
    assert np.abs([each["weights"][0][24] for each in moments] - opened).max() < 1e-3
