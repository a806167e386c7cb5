"""Classifier of matched speech and motion: towers with correlated tracks.

GENEA's matched and mismatched stimuli (Kucherenko et al. 2023), classified by a network. A piece of
speech and a piece of motion become tracks of 15 vectors a second, independently of each other;
their agreement is the correlation of the tracks over time. Constant properties of the whole piece
(a voice, a microphone, a posture, liveliness) are subtracted before the towers and after them, and
the size of a track does not count: so none of them can be a cue.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from conventions.joints import JOINT_INDEX
from conventions.rates import FPS
from model.motion.packing import Normaliser
from model.motion.rotations import axis_angle_from_matrix, matrix_from_axis_angle
from model.networks.autoencoder import ResidualBlock
from model.networks.config import MatchingConfig
from model.networks.trained import TrainedWeights

_ARM_JOINTS = ("collar", "shoulder", "elbow", "wrist", "index1", "middle1")
JOINTS_BY_TRACK: Mapping[str, tuple[str, ...]] = {
    **{f"{side}_{j}": (f"{side}_{j}",) for j in _ARM_JOINTS for side in ("left", "right")},
    "head": ("neck", "head"),
    "trunk": ("spine1", "spine2", "spine3"),
    "jaw": ("jaw",),
}
"""Joints with rotations that are multiplied, by the track of their angular speed."""
TRACKS = (*JOINTS_BY_TRACK, "jaw_open")
TRACKS_BY_PART: Mapping[str, tuple[int, ...]] = {
    "arms": tuple(range(2 * len(_ARM_JOINTS))),
    "trunk": (TRACKS.index("head"), TRACKS.index("trunk")),
    "face": (TRACKS.index("jaw"), TRACKS.index("jaw_open")),
}
"""Tracks of the parts that are classified separately: arms and hands, head and trunk, jaw."""
PREDICTED = [
    TRACKS.index(f"{side}_{j}") for j in ("shoulder", "elbow") for side in ("left", "right")
]
"""Tracks with a mean, the log speed of the arms, that is also predicted from speech alone."""
LOG_SPEED_OFFSET_RAD_S = 0.1
"""Speed (rad/s) added before the logarithm: a slower one counts as still."""
SMOOTH_FRAMES = 2.0
"""Deviation (frames) of the Gaussian over angular velocities, against sensor jitter."""
FRAMES_PER_VECTOR = 2
"""Frames of motion under each vector of a tower's track."""
MIN_SIZE = 1e-3
"""Smallest norm of a track; one with less movement agrees with nothing."""


def speed_and_jaw_features(poses: Float[Tensor, "B T 165"]) -> Float[Tensor, "B T tracks"]:
    """Compute `TRACKS`, not normalised: log angular speeds (rad/s) and jaw opening (rad).

    From local axis-angle (rad). All but the jaw opening do not depend on the pose.
    """
    joints = poses.unflatten(-1, (-1, 3))
    tracks = []
    for names in JOINTS_BY_TRACK.values():
        turned, *further = (matrix_from_axis_angle(joints[:, :, JOINT_INDEX[n]]) for n in names)
        for matrices in further:
            turned = turned @ matrices
        steps = axis_angle_from_matrix(turned[:, :-1].mT @ turned[:, 1:])
        velocity = _smooth(torch.cat([steps[:, :1], steps], dim=1)) * FPS
        tracks.append((velocity.norm(dim=-1) + LOG_SPEED_OFFSET_RAD_S).log())
    tracks.append(_smooth(joints[:, :, JOINT_INDEX["jaw"]]).norm(dim=-1))
    return torch.stack(tracks, dim=-1)


def _smooth(x: Float[Tensor, "B T 3"]) -> Float[Tensor, "B T 3"]:
    reach = round(3 * SMOOTH_FRAMES)
    weights = torch.exp(-0.5 * (torch.arange(-reach, reach + 1) / SMOOTH_FRAMES).square())
    kernel = (weights / weights.sum()).to(x).expand(3, 1, -1)
    padded = F.pad(x.transpose(1, 2), (reach, reach), mode="replicate")
    return F.conv1d(padded, kernel, groups=3).transpose(1, 2)


def remove_mean(x: Float[Tensor, "B T C"]) -> Float[Tensor, "B T C"]:
    """Subtract each channel's mean over the piece."""
    return x - x.mean(1, keepdim=True)


def centred_log_arm_speed(tracks: Float[Tensor, "B T tracks"]) -> Float[Tensor, "B T2 1"]:
    """Compute the arms' centred log speed from `speed_and_jaw_features` at the towers' rate."""
    mean = tracks[..., PREDICTED].mean(-1, keepdim=True).transpose(1, 2)
    return remove_mean(F.avg_pool1d(mean, FRAMES_PER_VECTOR, ceil_mode=True).transpose(1, 2))


class Tower(nn.Module):
    """Convolutional encoder of frames to a centred track per name, at half the frame rate.

    Ends are replicated, so that constant input gives a constant track.
    """

    def __init__(
        self, channels: int, width: int, names: Sequence[str], config: MatchingConfig
    ) -> None:
        super().__init__()
        held = "replicate"
        self.inside = nn.Conv1d(channels, width, 5, FRAMES_PER_VECTOR, padding=2, padding_mode=held)
        self.blocks = nn.Sequential(*(ResidualBlock(width, d, held) for d in config.dilations))
        self.out = nn.ModuleDict({name: nn.Conv1d(width, config.track_dim, 1) for name in names})

    def forward(self, x: Float[Tensor, "B T C"]) -> dict[str, Float[Tensor, "B T2 dim"]]:
        hidden = F.silu(self.blocks(self.inside(remove_mean(x).transpose(1, 2))))
        return {name: remove_mean(out(hidden).transpose(1, 2)) for name, out in self.out.items()}


class MatchingNetwork(nn.Module):
    """Network that maps pieces of speech and of motion to tracks; `agreement` compares them."""

    def __init__(self, config: MatchingConfig) -> None:
        super().__init__()
        self.config = config
        self.speech = Tower(config.speech_dim, config.speech_width, tuple(TRACKS_BY_PART), config)
        self.motion = nn.ModuleDict(
            {
                part: Tower(len(columns), config.motion_width, (part,), config)
                for part, columns in TRACKS_BY_PART.items()
            }
        )
        self.speed = nn.Linear(config.track_dim, 1, bias=False)
        """Projection of the speech's track for the arms to their log speed."""
        self.log_scale = nn.Parameter(torch.full((len(TRACKS_BY_PART),), 2.0))
        """Logarithm of the factor of agreements in the contrastive loss, one for each part."""

    def encode_speech(
        self, speech: Float[Tensor, "B T dim"]
    ) -> dict[str, Float[Tensor, "B T2 track"]]:
        """Compute the tracks of speech by body part."""
        return self.speech(speech)

    def encode_motion(
        self, tracks: Float[Tensor, "B T tracks"]
    ) -> dict[str, Float[Tensor, "B T2 track"]]:
        """Compute the tracks of a motion by body part, from normalised `speed_and_jaw_features`."""
        return {
            part: self.motion[part](tracks[..., columns])[part]
            for part, columns in TRACKS_BY_PART.items()
        }

    def forward(
        self, speech: Float[Tensor, "B T dim"], tracks: Float[Tensor, "B T tracks"]
    ) -> tuple[dict[str, Tensor], dict[str, Tensor], Float[Tensor, "B T2 1"], Tensor]:
        """Compute tracks of speech and of motion, predicted arm speed, and `log_scale`."""
        speech_codes = self.encode_speech(speech)
        return (
            speech_codes,
            self.encode_motion(tracks),
            self.speed(speech_codes["arms"]),
            self.log_scale,
        )


def agreement(
    motion_track: Float[Tensor, "B T dim"], speech_track: Float[Tensor, "A T dim"]
) -> Float[Tensor, "B A"]:
    """Correlate every motion's track with every speech's, over time and channels."""
    motion_track, speech_track = (
        F.normalize(x.flatten(1), dim=-1, eps=MIN_SIZE) for x in (motion_track, speech_track)
    )
    return motion_track @ speech_track.T


@dataclass(frozen=True)
class SpeechMotionMatcher:
    """Trained classifier with statistics of `speed_and_jaw_features`; its weights are constant."""

    network: MatchingNetwork
    normaliser: Normaliser
    sha256: str

    @torch.inference_mode()
    def agreements(
        self,
        poses: Float[Tensor, "B T 165"],
        speech: Float[Tensor, "A T dim"],
        parts: Sequence[str],
    ) -> Float[Tensor, "B A"]:
        """Compute the agreement of every motion with every speech, summed over ``parts``."""
        speech_codes = self.network.encode_speech(speech)
        motion_codes = self.network.encode_motion(
            self.normaliser.normalise(speed_and_jaw_features(poses))
        )
        return torch.stack(
            [agreement(motion_codes[part], speech_codes[part]) for part in parts]
        ).sum(0)

    @torch.inference_mode()
    def measured_and_predicted_log_arm_speed(
        self, poses: Float[Tensor, "B T 165"], speech: Float[Tensor, "B T dim"]
    ) -> tuple[Float[Tensor, "B T2 1"], Float[Tensor, "B T2 1"]]:
        """Compute the arms' centred log speed, of the motion and predicted from speech."""
        tracks = self.normaliser.normalise(speed_and_jaw_features(poses))
        speeds = self.network.speed(self.network.encode_speech(speech)["arms"])
        return centred_log_arm_speed(tracks), speeds


def load_matcher(folder: Path, name: str) -> SpeechMotionMatcher:
    """Load the classifier."""
    trained = TrainedWeights.read(folder, name)
    network = trained.load_into(MatchingNetwork(trained.card.config(MatchingConfig, "matching")))
    return SpeechMotionMatcher(network, trained.normaliser, trained.sha256)
