"""What a training step hears and what it aims at, made once for all clips.

The step then reads a window's rows instead of converting and posing it again each time it is drawn.
"""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn
from tqdm import tqdm

from conventions.joints import NUM_JOINTS
from model.data.prepared import Batch, PreparedData
from model.motion.kinematics import RestSkeleton
from model.motion.packing import MOTION_DIM, Decoded, decode, root_positions, to_vectors
from model.motion.packing import rotations as rotations_of
from model.motion.spaces import AXIS_ANGLE_MOTION_DIM, ROOT_DIM, RootMotion, RotationSpace
from model.speech.features import augment_mel, in_other_throats
from model.storage.files import written_atomically
from model.training.config import TrainConfig

BLOCK_FRAMES = 2000
TARGETS_FORMAT = 2


@dataclass(frozen=True)
class Targets:
    """Arrays of all frames of a `PreparedData`, in one rotation space."""

    space: RotationSpace
    root: RootMotion
    skeleton: RestSkeleton
    vectors: np.ndarray
    """(N, C) motion vectors, not normalised."""
    rooted: np.ndarray
    """(N, 165) joint positions in metres, the pelvis where the rest pose has it."""

    def of(self, batch: Batch, *, rotations: bool) -> tuple[Float[Tensor, "B T C"], Decoded]:
        """Vectors of a batch's windows, and what they mean.

        Args:
            rotations: whether global rotations and vectors are asked for; without, they may be
                None.
        """
        vectors = self.windows(batch)
        if batch.mirrored.any():  # the arrays know no mirror
            mirrored = to_vectors(self.space, batch.poses, batch.transl, self.root)
            if self.root == "place":  # homes are known from the arrays only
                mirrored[..., -ROOT_DIM:] = vectors[..., -ROOT_DIM:]
                mirrored[batch.mirrored, :, -ROOT_DIM] *= -1
            return mirrored, decode(mirrored, self.space, self.skeleton, self.root)
        if rotations and self.space != "global":
            return vectors, decode(vectors, self.space, self.skeleton, self.root)
        decoded = Decoded(
            global_rot=rotations_of(vectors, self.space) if rotations else None,
            rooted=torch.from_numpy(self.rooted[batch.frames]).unflatten(-1, (NUM_JOINTS, 3)),
            root=root_positions(vectors[..., -ROOT_DIM:], self.root),
            global_vectors=vectors if rotations else None,
        )
        return vectors, decoded

    def windows(self, batch: Batch) -> Float[Tensor, "B T C"]:
        """Vectors of a batch's windows, not mirrored."""
        return torch.from_numpy(self.vectors[batch.frames])


def prepare_targets(
    data: PreparedData, space: RotationSpace, root: RootMotion, skeleton: RestSkeleton
) -> Targets:
    """Make the arrays beside those of ``data`` unless they are there already, then map them."""
    stem = f"{space}-{root}"
    width = AXIS_ANGLE_MOTION_DIM if space == "axis-angle" else MOTION_DIM
    columns = {f"vectors-{stem}": width, f"rooted-{stem}": 3 * NUM_JOINTS}
    paths = [data.folder / f"{name}.raw" for name in columns]
    origin = {"format": TARGETS_FORMAT, "rest_joints": skeleton.rest_joints.tolist()}
    index = data.folder / f"targets-{stem}.json"
    if not index.is_file() or json.loads(index.read_text()) != origin:
        _write(data, space, root, skeleton, paths)
        with written_atomically(index) as path:
            path.write_text(json.dumps(origin))
    vectors, rooted = (
        np.memmap(path, np.float32, "r", shape=(len(data.poses), width))
        for path, width in zip(paths, columns.values(), strict=True)
    )
    return Targets(space, root, skeleton, vectors, rooted)


@torch.inference_mode()
def _write(
    data: PreparedData,
    space: RotationSpace,
    root: RootMotion,
    skeleton: RestSkeleton,
    paths: list[Path],
) -> None:
    with (
        written_atomically(paths[0]) as vectors_path,
        written_atomically(paths[1]) as rooted_path,
        vectors_path.open("wb") as vectors_file,
        rooted_path.open("wb") as rooted_file,
    ):
        for clip in tqdm(data.clips, desc=f"{space} targets", unit="clip"):
            rows = slice(clip.start, clip.stop)
            transl = data.transl[rows] - (data.home(clip) if root == "place" else 0.0)
            vectors = to_vectors(
                space,
                torch.from_numpy(np.array(data.poses[rows]))[None],
                torch.from_numpy(np.asarray(transl, np.float32))[None],
                root,
            )[0]
            vectors_file.write(vectors.numpy().tobytes())
            for block in vectors.split(BLOCK_FRAMES):
                rooted = decode(block[None], space, skeleton, root).rooted[0]
                rooted_file.write(rooted.flatten(-2).contiguous().numpy().tobytes())


def heard(
    config: TrainConfig, network: nn.Module, batch: Batch, generator: torch.Generator
) -> Float[Tensor, "B T dim"]:
    """The speech features of the whole batch; in training as some microphone might have caught
    them, of some throat."""
    speech = batch.speech
    if network.training and config.throats:
        speech = in_other_throats(speech, config.throats, generator)
    if network.training and config.augment_speech:
        speech = augment_mel(speech, generator)
    return speech
