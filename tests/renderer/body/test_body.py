"""The body: zero pose, looks, agreement with ``smplx``, made SMPL-X files, and bad input."""

import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from conventions.joints import FINGERTIP_VERTICES, JOINT_INDEX, NUM_JOINTS, PARENTS
from conventions.views import BODY_BUILDS
from model.motion import kinematics
from model.motion.rotations import matrix_from_axis_angle
from renderer.body.body import Body, BodyMotion, load_body
from renderer.body.body_file import MAX_FACES, MAX_VERTICES, OPEN_BODY_PATH, BodyError
from renderer.body.look import CLAY, REGION_INDEX

NUM_FRAMES = 7
SIDES = ("left", "right")
MADE_VERTICES = 10
COMPARED_VERTICES = 9930  # the smplx package takes landmarks by vertex numbers up to here


@pytest.fixture(scope="module")
def body() -> Body:
    return load_body()


def random_motion(
    seed: int = 0, num_frames: int = NUM_FRAMES, basis: str = "arkit52", num_expressions: int = 52
) -> BodyMotion:
    rng = np.random.default_rng(seed)
    poses = rng.normal(size=(num_frames, 165)) * 0.3
    trans = rng.normal(size=(num_frames, 3))
    expressions = np.zeros((num_frames, 100))
    expressions[:, :num_expressions] = rng.uniform(0, 0.5, (num_frames, num_expressions))
    return BodyMotion(poses, trans, expressions, basis, betas=np.zeros(300))


def all_vertices(body: Body, motion: BodyMotion, chunk: int = 64) -> np.ndarray:
    return np.concatenate(list(body.posed_vertices(motion, chunk)))


def max_distance_mm(a: np.ndarray, b: np.ndarray) -> float:
    return 1e3 * float(np.linalg.norm(np.asarray(a) - np.asarray(b), axis=-1).max())


def smplx_file(path: Path, **changes: object) -> Path:
    """A random body in the licensed file format, ten vertices; ``None`` removes a key."""
    rng = np.random.default_rng(3)
    weights = rng.random((MADE_VERTICES, NUM_JOINTS)) ** 8
    regressor = rng.random((NUM_JOINTS, MADE_VERTICES))
    kintree = np.stack([np.array(PARENTS), np.arange(NUM_JOINTS)])
    arrays: dict[str, object] = {
        "v_template": rng.normal(size=(MADE_VERTICES, 3)),
        "f": rng.integers(0, MADE_VERTICES, (12, 3)).astype(np.uint32),
        "weights": weights / weights.sum(1, keepdims=True),
        "J_regressor": regressor / regressor.sum(1, keepdims=True),
        "kintree_table": kintree.astype(np.uint32),
        "shapedirs": rng.normal(size=(MADE_VERTICES, 3, 20)) * 0.01,
        "posedirs": rng.normal(size=(MADE_VERTICES, 3, 486)) * 0.01,
        "part2num": np.array({"head": 1}, dtype=object),
    }
    arrays.update(changes)
    np.savez(path, **{key: array for key, array in arrays.items() if array is not None})
    return path


def test_zero_pose_is_the_template_and_translation_moves_every_vertex(body):
    (posed,) = body.posed_vertices(BodyMotion.zero_pose())
    np.testing.assert_allclose(posed[0], body.template, atol=1e-6)
    motion = random_motion(num_frames=3)
    still = replace(motion, trans=np.zeros_like(motion.trans))
    moved = all_vertices(body, motion) - motion.trans[:, None]
    assert max_distance_mm(moved, all_vertices(body, still)) < 1e-3


@pytest.mark.parametrize("chunk", [1, 3, 7, 64])
def test_chunk_size_does_not_change_the_result(body, chunk):
    motion = random_motion(num_frames=13)
    chunks = list(body.posed_vertices(motion, chunk))
    assert [len(part) for part in chunks[:-1]] == [chunk] * (len(chunks) - 1)
    assert max_distance_mm(np.concatenate(chunks), all_vertices(body, motion, 13)) < 1e-3


def test_joints_are_those_of_forward_kinematics(body):
    motion = random_motion()
    R_parent_joint = matrix_from_axis_angle(torch.from_numpy(motion.poses).reshape(-1, 55, 3))
    _, positions = kinematics.forward_kinematics(
        R_parent_joint, kinematics.open_body_skeleton(), torch.from_numpy(motion.trans)
    )
    assert max_distance_mm(body.joint_positions(motion), positions.numpy()) < 0.02


def test_skeleton_of_the_model_is_that_of_the_body(body):
    rig = kinematics.open_body_skeleton()
    assert max_distance_mm(rig.rest_joints.numpy(), body.rest_joints) < 0.02
    for k, name in enumerate(kinematics.FINGERTIP_NAMES):
        joint = body.rest_joints[JOINT_INDEX[f"{name}3"]]
        offset = body.template[FINGERTIP_VERTICES[name]] - joint
        assert max_distance_mm(rig.tip_offsets[k].numpy(), offset) < 0.02
        bone = joint - body.rest_joints[JOINT_INDEX[f"{name}2"]]
        assert 0.010 < offset @ bone / np.linalg.norm(bone) < 0.035, name


def expanded_to_smplx(body: Body, path: Path) -> Path:
    """The open body's first vertices as an SMPL-X file: dense weights, a joint regressor."""
    num_vertices = COMPARED_VERTICES
    columns = slice(300, 300 + len(body.expression_dirs))
    moved = body.expression_vertices < num_vertices
    shapedirs = np.zeros((num_vertices, 3, 400), np.float32)
    shapedirs[body.expression_vertices[moved], :, columns] = body.expression_dirs[
        :, moved
    ].transpose(1, 2, 0)
    corrected = body.pose_vertices[body.pose_vertices < num_vertices]
    posedirs = np.zeros((num_vertices, 3, 486), np.float32)
    posedirs[corrected] = body.pose_dirs[: 3 * len(corrected)].toarray().reshape(-1, 3, 486)
    faces = body.faces[(body.faces < num_vertices).all(1)]
    # A regressor that gives the rest joints from vertices that no expression moves.
    still = np.setdiff1d(np.arange(num_vertices), body.expression_vertices)
    points = np.c_[body.template[still].astype(np.float64), np.ones(len(still))]
    regressor = np.zeros((NUM_JOINTS, num_vertices))
    regressor[:, still] = np.c_[body.rest_joints, np.ones(NUM_JOINTS)] @ np.linalg.pinv(points)
    none = np.zeros(45, np.float32)
    np.savez(
        path,
        v_template=body.template[:num_vertices],
        f=faces.astype(np.uint32),
        weights=body.weights[:num_vertices].toarray(),
        J_regressor=regressor,
        kintree_table=np.stack([np.array(PARENTS), np.arange(NUM_JOINTS)]).astype(np.uint32),
        shapedirs=shapedirs,
        posedirs=posedirs,
        hands_meanl=none,
        hands_meanr=none,
        hands_componentsl=np.eye(45),
        hands_componentsr=np.eye(45),
        lmk_faces_idx=np.zeros(51, np.int64),
        lmk_bary_coords=np.zeros((51, 3)),
    )
    return path


@pytest.fixture(scope="module")
def smplx_path(body: Body, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return expanded_to_smplx(body, tmp_path_factory.mktemp("smplx") / "SMPLX_NEUTRAL.npz")


def smplx_result(path: Path, motion: BodyMotion) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and the 55 joints from the independent ``smplx`` package."""
    smplx = pytest.importorskip("smplx")
    model = smplx.SMPLX(
        str(path),
        ext="npz",
        batch_size=motion.num_frames,
        use_pca=False,
        flat_hand_mean=True,
        use_face_contour=False,
        num_betas=300,
        num_expression_coeffs=100,
    )
    poses = torch.from_numpy(motion.poses).reshape(-1, 55, 3)
    with torch.no_grad():
        result = model(
            betas=torch.from_numpy(np.tile(motion.betas, (motion.num_frames, 1))),
            expression=torch.from_numpy(motion.expressions),
            global_orient=poses[:, 0],
            body_pose=poses[:, 1:22].flatten(1),
            jaw_pose=poses[:, 22],
            leye_pose=poses[:, 23],
            reye_pose=poses[:, 24],
            left_hand_pose=poses[:, 25:40].flatten(1),
            right_hand_pose=poses[:, 40:].flatten(1),
            transl=torch.from_numpy(motion.trans),
        )
    return result.vertices.numpy(), result.joints.numpy()


def test_agrees_with_the_smplx_package_as_it_is_and_as_a_licensed_file(body, smplx_path):
    """The same numbers through the package, the licensed format and the compact one."""
    motion = random_motion(num_frames=3)
    vertices, joints = smplx_result(smplx_path, motion)
    ours = all_vertices(body, motion)
    assert max_distance_mm(ours[:, :COMPARED_VERTICES], vertices) < 0.01
    assert max_distance_mm(body.joint_positions(motion), joints[:, :55]) < 0.01
    tip = joints[:, 73]  # the package's right middle fingertip
    assert max_distance_mm(ours[:, FINGERTIP_VERTICES["right_middle"]], tip) < 0.01
    licensed = load_body(smplx_path)
    assert licensed.expression_basis == "flame100"
    flame_motion = replace(motion, expression_basis="flame100")
    assert max_distance_mm(all_vertices(licensed, flame_motion), vertices) < 0.01


def test_the_right_hand_is_the_mirror_of_the_left(body):
    """Whatever is bent on one side: neither hand has a mean pose of its own."""
    fingers = [name.removeprefix("left_") for name in FINGERTIP_VERTICES if name.startswith("left")]
    poses = np.zeros((1, 55, 3))
    for finger, bent in zip(fingers, np.random.default_rng(2).normal(size=(5, 3, 3)), strict=True):
        for k, turn in enumerate(0.4 * bent, start=1):
            poses[0, JOINT_INDEX[f"left_{finger}{k}"]] = turn
            poses[0, JOINT_INDEX[f"right_{finger}{k}"]] = turn * [1, -1, -1]  # in the plane x = 0
    (posed,) = all_vertices(body, replace(BodyMotion.zero_pose(), poses=poses.reshape(1, 165)))
    left, right = ([FINGERTIP_VERTICES[f"{side}_{name}"] for name in fingers] for side in SIDES)
    wrists = [body.rest_joints[JOINT_INDEX[f"{side}_wrist"]] for side in SIDES]
    assert np.linalg.norm(posed[left] - body.template[left], axis=1).min() > 0.01
    mirrored = (posed[right] - wrists[1]) * [-1, 1, 1]
    assert max_distance_mm(mirrored, posed[left] - wrists[0]) < 1


def test_mean_hands_of_a_licensed_file_are_left_out(tmp_path):
    """BEAT2 stores whole turns of the fingers, not differences from the file's mean hands."""
    motion = random_motion(basis="flame100", num_expressions=10)
    means = np.full(45, 0.3), np.full(45, -0.2)
    with_means = dict(zip(("hands_meanl", "hands_meanr"), means, strict=True))
    bodies = [
        load_body(smplx_file(tmp_path / f"{number}.npz", **changes))
        for number, changes in enumerate(({}, with_means))
    ]
    one, other = (all_vertices(each, motion) for each in bodies)
    np.testing.assert_array_equal(one, other)


def posed_as_published(
    file: dict[str, np.ndarray], motion: BodyMotion, frame: int, num_betas: int
) -> tuple[np.ndarray, np.ndarray]:
    """Vertices and joints by equations 2 to 6 of SMPL (Loper et al. 2015), with expressions.

    One loop per joint and vertex over the arrays of the file: nothing shared with the renderer.
    """
    num_expressions = min(file["shapedirs"].shape[2] - num_betas, 100)
    blend = np.zeros(file["shapedirs"].shape[2])
    blend[:num_betas] = motion.betas[:num_betas]
    blend[num_betas : num_betas + num_expressions] = motion.expressions[frame, :num_expressions]
    shaped = file["v_template"] + file["shapedirs"] @ blend
    joints = file["J_regressor"] @ shaped
    rotations = Rotation.from_rotvec(motion.poses[frame].reshape(55, 3)).as_matrix()
    world = [np.eye(4) for _ in range(NUM_JOINTS)]
    for joint in range(NUM_JOINTS):
        local = np.eye(4)
        local[:3, :3], local[:3, 3] = rotations[joint], joints[joint]
        if joint:
            parent = int(file["kintree_table"][0, joint])
            local[:3, 3] -= joints[parent]
            local = world[parent] @ local
        world[joint] = local
    feature = np.concatenate([(rotation - np.eye(3)).ravel() for rotation in rotations[1:]])
    posed = []
    for vertex in range(len(shaped)):
        corrected = shaped[vertex] + file["posedirs"][vertex] @ feature
        point = np.zeros(3)
        for joint in range(NUM_JOINTS):
            from_joint = np.append(corrected - joints[joint], 1.0)
            point += file["weights"][vertex, joint] * (world[joint] @ from_joint)[:3]
        posed.append(point + motion.trans[frame])
    return np.array(posed), np.stack(world)[:, :3, 3] + motion.trans[frame]


@pytest.mark.parametrize(("columns", "num_betas"), [(20, 10), (110, 10), (400, 300)])
def test_a_licensed_file_is_posed_as_published(tmp_path, columns, num_betas):
    """Files of 2019 have 10 betas and 10 expressions, those of 2020 have 300 and 100."""
    rng = np.random.default_rng(11)
    shapedirs = 0.01 * rng.standard_normal((MADE_VERTICES, 3, columns))
    made = smplx_file(tmp_path / "body.npz", shapedirs=shapedirs)
    plain = random_motion(num_frames=3, basis="flame100", num_expressions=100)
    motion = replace(plain, betas=rng.normal(size=300))
    licensed = load_body(made)
    assert licensed.shape_dirs.shape[2] == num_betas
    np.testing.assert_allclose(licensed.vertex_colors, [CLAY] * MADE_VERTICES)
    with np.load(made, allow_pickle=False) as file:
        held = {key: file[key] for key in file.files if key != "part2num"}
    ours, our_joints = all_vertices(licensed, motion), licensed.joint_positions(motion)
    for frame in (0, 2):
        vertices, joints = posed_as_published(held, motion, frame, num_betas)
        assert max_distance_mm(ours[frame], vertices) < 0.05
        assert max_distance_mm(our_joints[frame], joints) < 0.05


def test_what_the_open_body_cannot_show_is_left_out_and_said(body):
    flame, plain = random_motion(basis="flame100"), random_motion(num_expressions=0)
    assert max_distance_mm(all_vertices(body, flame), all_vertices(body, plain)) == 0
    (note,) = body.unsupported_notes(flame)
    assert "flame100" in note and "arkit52" in note
    assert body.unsupported_notes(random_motion(basis="flame100", num_expressions=0)) == ()
    plain = random_motion()
    shaped = replace(plain, betas=np.full(300, 2.0))
    assert max_distance_mm(all_vertices(body, shaped), all_vertices(body, plain)) == 0
    assert body.unsupported_notes(plain) == ()
    assert "betas" in body.unsupported_notes(shaped)[0]


def waist_m(body: Body) -> float:
    vertices = body.template
    near = (np.abs(vertices[:, 1] + 0.2) < 0.02) & (np.abs(vertices[:, 0]) < 0.3)
    return float(np.ptp(vertices[near, 0]) + np.ptp(vertices[near, 2]))


def test_every_look_stands_on_the_same_skeleton(body):
    """So the motion, its joints and its fingertips are the same whatever the look."""
    tips = list(FINGERTIP_VERTICES.values())
    for build in BODY_BUILDS[1:]:
        other = load_body(look=f"{build}-light")
        np.testing.assert_array_equal(other.rest_joints, body.rest_joints)
        np.testing.assert_array_equal(other.faces, body.faces)
        assert max_distance_mm(other.template[tips], body.template[tips]) < 2.0
        assert abs(other.template[:, 1].min() - body.template[:, 1].min()) < 1e-3, "soles"
        difference = np.linalg.norm(other.template - body.template, axis=1)
        assert difference.mean() > 0.005 and difference.max() < 0.1
        girth = waist_m(other) / waist_m(body)
        assert girth < 0.97 if build == "slender" else 1 / girth < 0.97
        for joint in (JOINT_INDEX["left_eye"], JOINT_INDEX["right_eye"]):
            eyeball = other.template[other.weights[:, [joint]].toarray()[:, 0] == 1]
            middle = (eyeball.min(0) + eyeball.max(0)) / 2
            assert max_distance_mm(middle, body.rest_joints[joint]) < 1.0


def test_clay_has_one_hue_and_a_readable_mouth(body):
    colors = body.vertex_colors
    assert colors.shape == (body.num_vertices, 3)
    assert len(np.unique(colors, axis=0)) >= 10
    body = load_body(look="broad-clay")
    colors, regions = body.vertex_colors, body.regions
    np.testing.assert_allclose(
        colors / colors[:, :1], np.tile(CLAY, (len(colors), 1)) / CLAY[0], rtol=1e-5
    )
    lips, mouth = (colors[regions == REGION_INDEX[name], 0].mean() for name in ("lips", "mouth"))
    assert lips == pytest.approx(CLAY[0]) and mouth < 0.5 * lips


def test_a_look_that_cannot_be_had_is_refused(tmp_path):
    with pytest.raises(BodyError, match="Unknown look 'tall'; choose one of average-light"):
        load_body(look="tall")
    with pytest.raises(BodyError, match=r"body\.npz has only one look"):
        load_body(smplx_file(tmp_path / "body.npz"), look="slender-dark")


def test_memory_is_that_of_one_chunk(body):
    """A longer motion does not make the stream hold more."""

    def peak(num_frames: int) -> int:
        motion = random_motion(num_frames=num_frames)
        tracemalloc.start()
        for _ in body.posed_vertices(motion, chunk_frames=8):
            pass
        top = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return top

    assert peak(64) < 1.1 * peak(16)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"v_template": None}, "no array 'v_template'"),
        ({"J_regressor": np.array([{"sparse": 1}], dtype=object)}, "pickled object"),
        ({"v_template": np.zeros((MAX_VERTICES + 1, 3), np.int8)}, "has 100001 vertices"),
        ({"f": np.zeros((MAX_FACES + 1, 3), np.int8)}, "has 200001 faces"),
        ({"f": np.full((4, 3), -1)}, "refers to vertex -1"),
        ({"shapedirs": np.full((MADE_VERTICES, 3, 20), np.inf)}, "'shapedirs' holds values"),
        ({"kintree_table": np.zeros((2, 55), np.uint32)}, "not the joint tree"),
        (
            {"f": np.full((4, 3), MADE_VERTICES, np.uint32)},
            "refers to vertex 10, but the vertices are 0 to 9",
        ),
        ({"weights": np.zeros((MADE_VERTICES, 55))}, "do not sum to one"),
        ({"posedirs": np.zeros((MADE_VERTICES, 3, 207))}, "posedirs"),
        ({"v_template": np.array([["a", "b", "c"]] * MADE_VERTICES)}, "not numbers"),
    ],
)
def test_bad_body_files(tmp_path, changes, words):
    path = smplx_file(tmp_path / "body.npz", **changes)
    with pytest.raises(BodyError, match=words) as caught:
        load_body(path)
    assert "body.npz" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_open_body_of_another_format_is_refused(tmp_path):
    np.savez(tmp_path / "open_body.npz", open_body_format=np.array(1))
    with pytest.raises(BodyError, match="format 1; this program reads format 2"):
        load_body(tmp_path / "open_body.npz")


def test_files_that_are_no_body(tmp_path):
    np.savez(tmp_path / "motion.npz", poses=np.zeros((3, 165)))
    np.save(tmp_path / "array.npy", np.zeros(3))
    content = OPEN_BODY_PATH.read_bytes()
    damaged = {"text": b"not a body", "cut": content[:100_000]}
    for from_end in (30, 900, 2500, 3400):  # all over the archive's directory, and its middle
        changed = bytearray(content)
        for place in (len(content) // 2, len(content) - from_end):
            changed[place] ^= 0xFF
        damaged[str(from_end)] = bytes(changed)
    for name, data in damaged.items():
        (tmp_path / f"{name}.npz").write_bytes(data)
    for path in (*sorted(tmp_path.iterdir()), tmp_path / "nothing.npz", tmp_path):
        with pytest.raises(BodyError) as caught:
            load_body(path)
        assert "\n" not in str(caught.value), path


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"trans": np.full((4, 3), 250.0)}, "250 m from the origin"),
        ({"betas": np.full(300, 1e6)}, "betas"),
    ],
)
def test_bad_motions(changes, words):
    with pytest.raises(BodyError, match=words):
        replace(BodyMotion.zero_pose(4), **changes)
