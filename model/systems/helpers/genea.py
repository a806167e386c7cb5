"""GENEA's encoder of 30, 60 or 90 frames, used for FGD in its evaluations, if the user has one.

Nothing of it is bundled. The network is reimplemented from the public evaluation scripts
(genea_numerical_evaluations, ``model_checkpoint_N.bin``): four convolutions over time, then three
linear layers to a code of 32 numbers for each piece. The file tells all widths and the length.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Shaped
from torch import Tensor, nn

from conventions.joints import JOINT_INDEX
from model.metrics.protocols.table import GENEA_PIECE_FRAMES
from model.motion.kinematics import RestSkeleton
from model.motion.motion import Motion
from model.motion.tracks import track_points
from model.storage.cards import CheckpointError
from model.storage.checkpoint import check_tensors, read_torch_checkpoint

CODE_DIM = 32
_PREFIX = "pose_encoder."
_JOINTS = (
    *("spine1", "spine2", "spine3", "neck", "neck", "head"),
    *("right_collar", "right_shoulder", "right_elbow", "right_wrist"),
    *("left_collar", "left_shoulder", "left_elbow", "left_wrist"),
)
"""Joints of SMPL-X for those of GENEA's; the second neck is the middle of neck and head."""
_MEAN_CM = np.array([
    [0.4546838, 21.7154182, -0.9253521], [1.0481254, 30.1385837, 0.3579833],
    [1.7905287, 38.52385, 1.6368418], [2.6107317, 49.0982409, 4.4734471],
    [3.1735519, 55.6535274, 6.7887565], [3.7772244, 62.2592191, 8.9336633],
    [2.1826697, 45.3888185, 7.9697471], [-15.1223696, 47.1955581, 2.9793349],
    [-27.7766248, 24.2758849, 3.1701817], [-26.72694, 23.5385736, 20.4576112],
    [2.2024159, 45.3871329, 7.9702768], [19.7637237, 44.6687317, 4.375252],
    [27.5912466, 19.1198408, 5.9903543], [21.8780328, 16.8195207, 22.9530664],
])  # fmt: skip
_SPREAD_CM = np.array([
    [0.8220535, 0.1115134, 0.7292415], [1.6780658, 0.2834227, 1.4491553],
    [2.6036282, 0.5033388, 2.3467814], [3.8314201, 0.9260952, 3.5850173],
    [4.665101, 1.214391, 4.1563822], [5.5331544, 1.4715467, 4.6826288],
    [3.4655923, 1.2627345, 3.1362282], [3.4534337, 3.2095834, 3.7630859],
    [5.2367976, 9.1622181, 9.4337443], [10.0051307, 18.7604784, 12.0112832],
    [3.4653989, 1.2635428, 3.1361777], [3.3527777, 4.3935712, 3.7647275],
    [4.9868833, 7.7716174, 9.3219174], [10.0696823, 17.331519, 11.2074617],
])  # fmt: skip
"""Mean and standard deviation of the positions, which the published scripts contain."""


class GeneaEncoder(nn.Module):
    """Encoder of pieces of upper-body positions to codes of 32 numbers."""

    def __init__(self, widths: tuple[int, int, int, int], length: int) -> None:
        super().__init__()
        self.length = length
        first, second, third, last = widths
        convolutions = [
            nn.Sequential(nn.Conv1d(a, b, width, stride), nn.BatchNorm1d(b), nn.LeakyReLU(0.2))
            for a, b, width, stride in (
                (_MEAN_CM.size, first, 3, 1), (first, second, 3, 1), (second, third, 4, 2)
            )
        ]  # fmt: skip
        self.net = nn.Sequential(*convolutions, nn.Conv1d(third, last, 3))
        # The published LeakyReLU(True) has a slope of 1: the layers are linear.
        self.out_net = nn.Sequential(
            nn.Linear(last * (length // 2 - 5), 256),
            nn.BatchNorm1d(256),
            nn.Identity(),
            nn.Linear(256, 128),
            nn.BatchNorm1d(128),
            nn.Identity(),
            nn.Linear(128, CODE_DIM),
        )

    def forward(self, pieces: Float[Tensor, "n T 42"]) -> Float[Tensor, "n 32"]:
        """Encode standardised pieces of the encoder's length."""
        return self.out_net(self.net(pieces.mT).flatten(1))


def load_genea_encoder(path: Path) -> GeneaEncoder:
    """Load the encoder from GENEA's file; raises CheckpointError for any other file."""
    what, advice = (
        "GENEA's encoder",
        "model_checkpoint_30, _60 or _90.bin from GENEA's evaluation code",
    )
    weights = {
        key.removeprefix(_PREFIX): each
        for key, each in read_torch_checkpoint(path).items()
        if key.startswith(_PREFIX) and not key.endswith("num_batches_tracked")
    }
    network = GeneaEncoder(*_sizes(weights, f"{path.name} is not {what}; give {advice}."))
    wanted = {
        key: each
        for key, each in network.state_dict().items()
        if not key.endswith("num_batches_tracked")
    }
    check_tensors(wanted, weights, path.name, what, advice)
    network.load_state_dict(weights, strict=False)
    return network.eval().requires_grad_(False)


def _sizes(
    tensors: Mapping[str, Shaped[Tensor, " ..."]], refusal: str
) -> tuple[tuple[int, int, int, int], int]:
    try:
        biases = [tensors[f"net.{place}.bias"] for place in ("0.0", "1.0", "2.0", "3")]
        first, second, third, last = (len(bias) for bias in biases)
        length = 2 * (tensors["out_net.0.weight"].shape[1] // last + 5)
    except (LookupError, TypeError, ZeroDivisionError):
        raise CheckpointError(refusal) from None
    if length not in GENEA_PIECE_FRAMES or max(first, second, third, last) > 512:
        raise CheckpointError(refusal)
    return (first, second, third, last), length


@torch.inference_mode()
def genea_codes(
    encoder: GeneaEncoder, motion: Motion, skeleton: RestSkeleton
) -> Float[np.ndarray, "codes 32"]:
    """Compute the codes of a clip's pieces, every half of their length; empty for a short clip."""
    length = encoder.length
    starts = range(0, motion.num_frames - length, length // 2)
    if not starts:
        return np.zeros((0, CODE_DIM), np.float32)
    joints = track_points(motion, skeleton).joints
    places = (joints - joints[:, :1])[:, [JOINT_INDEX[name] for name in _JOINTS]] * 100
    places[:, 4] = (places[:, 4] + places[:, 5]) / 2
    frames = ((places - _MEAN_CM) / _SPREAD_CM).reshape(len(places), -1)
    pieces = np.stack([frames[start : start + length] for start in starts])
    return encoder(torch.from_numpy(pieces).float()).numpy()
