"""Arrays made once must say what converting each window anew would say."""

import json

import numpy as np
import pytest
import torch

from model.data.prepared import prepare
from model.motion.kinematics import open_body_skeleton
from model.motion.packing import ROTATION_DIM, decode, to_vectors
from model.speech.features import MelEncoder
from model.training.targets import prepare_targets
from tests.model.made import make_data_folder


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    root = tmp_path_factory.mktemp("targets")
    return prepare(make_data_folder(root / "data"), root / "prepared", MelEncoder())


@pytest.mark.parametrize("space", ["local", "global", "axis-angle"])
@pytest.mark.parametrize("rotations", [False, True])
def test_mapped_targets_equal_converted_windows(data, space, rotations):
    skeleton = open_body_skeleton()
    targets = prepare_targets(data, space, "velocity", skeleton)
    batch = data.window_batch(data.of_split("train"), 60, 5, np.random.default_rng(0))
    vectors, found = targets.of(batch, rotations=rotations)
    wanted_vectors = to_vectors(space, batch.poses, batch.transl)
    wanted = decode(wanted_vectors, space, skeleton)
    # The first velocity of a window is that from the frame before, which a window does not know.
    torch.testing.assert_close(vectors[:, 1:], wanted_vectors[:, 1:], atol=1e-4, rtol=1e-4)
    torch.testing.assert_close(found.positions, wanted.positions, atol=1e-4, rtol=1e-4)
    assert (found.positions[:, 0, 0, [0, 2]] - skeleton.rest_joints[0, [0, 2]]).abs().max() < 1e-6
    if rotations:
        assert found.global_rot is not None and wanted.global_rot is not None
        torch.testing.assert_close(found.global_rot, wanted.global_rot, atol=1e-5, rtol=1e-4)
        torch.testing.assert_close(
            found.global_vectors[..., :ROTATION_DIM],
            wanted.global_vectors[..., :ROTATION_DIM],
            atol=1e-5,
            rtol=1e-4,
        )


def test_places_are_from_where_each_clip_is_at_home(data):
    targets = prepare_targets(data, "global", "place", open_body_skeleton())
    for clip in data.clips:
        place = targets.vectors[clip.start : clip.stop, ROTATION_DIM:]
        np.testing.assert_allclose(place[:, [0, 2]].mean(0), 0, atol=1e-5)
        np.testing.assert_allclose(place[:, 1], data.transl[clip.start : clip.stop, 1], atol=1e-6)


@pytest.mark.parametrize("root", ["velocity", "place"])
def test_a_mirrored_window_is_the_mirror_image(data, root):
    skeleton = open_body_skeleton()
    targets = prepare_targets(data, "global", root, skeleton)
    batch = data.window_batch(data.of_split("train"), 60, 2, np.random.default_rng(0))
    _, seen = targets.of(batch, rotations=False)
    _, found = targets.of(batch.mirror(torch.tensor([True, False])), rotations=False)
    torch.testing.assert_close(found.root[1], seen.root[1], atol=1e-5, rtol=1e-4)
    torch.testing.assert_close(found.root[0, :, 1:], seen.root[0, :, 1:], atol=1e-5, rtol=1e-4)
    torch.testing.assert_close(found.root[0, :, 0], -seen.root[0, :, 0], atol=1e-5, rtol=1e-4)


def test_targets_of_another_skeleton_are_made_anew(data):
    index = data.folder / "targets-global-velocity.json"
    prepare_targets(data, "global", "velocity", open_body_skeleton())
    known = json.loads(index.read_text())
    known["rest_joints"][0][0] += 1.0
    index.write_text(json.dumps(known))
    (data.folder / "rooted-global-velocity.raw").write_bytes(b"")
    targets = prepare_targets(data, "global", "velocity", open_body_skeleton())
    assert len(targets.rooted) == len(data.poses)


def test_context_is_held_at_both_ends_of_a_clip(data):
    clip = data.of_split("train")[1]
    for start in (clip.start, clip.stop - 60):
        frames = np.arange(start, start + 60)[None]
        batch = data.batch(frames, [clip], context=25)
        rows = np.arange(start - 25, start + 85).clip(clip.start, clip.stop - 1)
        wanted = torch.from_numpy(data.speech[rows].astype(np.float32))
        torch.testing.assert_close(batch.speech[0], wanted)
