"""Does motion follow its speech? The wrong-speech test, on predictions and on finished motion."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from model.expression import predict_expressions
from model.flow import interpolate
from model.kinematics import global_from_local, joint_positions_from_global
from model.motion import Motion
from model.packing import pack, unpack
from model.rotations import matrix_from_rot6d, rot6d_from_matrix
from model.skeleton import JOINT_DEPTH, JOINT_INDEX, open_body_skeleton
from model.systems import System
from model.timing import FPS, SAMPLE_RATE

FLOW_TIMES = (0.0, 0.2, 0.4)
"""Early, where speech matters more than x_t."""
DEPTH_FLOW_TIME = 0.5
"""Of the position error by depth."""
SHIFT_S = 4.0
MAX_LAG_S = 0.5
SMOOTHING_FRAMES = 9
_WRISTS = [JOINT_INDEX["left_wrist"], JOINT_INDEX["right_wrist"]]

Features = Float[np.ndarray, "_ dim"]


def speech_tracks(right: Features, foreign: Features) -> dict[str, Features]:
    """The clip's own speech, the same shifted by 4 s in a circle, and another clip's."""
    return {
        "right": right,
        "shifted": np.roll(right, round(SHIFT_S * FPS), axis=0),
        "foreign": np.resize(foreign, right.shape),
    }


@dataclass(frozen=True)
class Prediction:
    """Errors of x_1 on one clip, without a seed pose, which would give most of the answer away."""

    errors: dict[str, float]
    """Mean squared error over `FLOW_TIMES` by kind of speech; normalised channels."""
    position_error_by_depth_m: list[float]
    """With the right speech at `DEPTH_FLOW_TIME`, the pelvis in place."""


@torch.inference_mode()
def predict_with(
    system: System, motion: Motion, tracks: Mapping[str, Features], speaker: int, batch_size: int
) -> Prediction:
    """The same windows, noise and flow times for every kind of speech."""
    config = system.config
    window = config.window_frames
    starts = range(0, motion.num_frames - window + 1, window)
    vectors = _vectors(system, motion)
    x_1 = system.normaliser.normalise(torch.stack([vectors[s : s + window] for s in starts]))
    x_0 = torch.randn(x_1.shape, generator=torch.Generator().manual_seed(0))
    errors: dict[str, float] = {}

    def predictions(track: Features, time: float) -> Float[Tensor, "windows T 333"]:
        speech = torch.from_numpy(np.ascontiguousarray(track))
        face = predict_expressions(system.expression_network, speech, speaker)
        parts = []
        for first in range(0, len(x_1), batch_size):
            rows = slice(first, first + batch_size)
            size = len(x_1[rows])
            t = torch.full((size,), time)
            parts.append(
                system.network(
                    interpolate(x_0[rows], x_1[rows], t),
                    t,
                    speech=torch.stack([speech[s : s + window] for s in starts[rows]]),
                    expression=torch.stack([face[s : s + window] for s in starts[rows]]),
                    seed=torch.zeros(size, config.seed_frames, x_1.shape[-1]),
                    speaker=torch.full((size,), speaker),
                    has_seed=torch.zeros(size, dtype=torch.bool),
                    has_speech=torch.ones(size, dtype=torch.bool),
                )
            )
        return torch.cat(parts)

    for kind, track in tracks.items():
        at_times = [(predictions(track, time) - x_1).square().mean() for time in FLOW_TIMES]
        errors[kind] = float(torch.stack(at_times).mean())
    late = system.normaliser.restore(predictions(tracks["right"], DEPTH_FLOW_TIME))
    distance = (_positions(system, late) - _positions(system, system.normaliser.restore(x_1))).norm(
        dim=-1
    )
    by_joint = distance.mean((0, 1)).numpy()
    depth = np.array(JOINT_DEPTH)
    by_depth = [float(by_joint[depth == d].mean()) for d in range(max(JOINT_DEPTH) + 1)]
    return Prediction(errors, by_depth)


def _vectors(system: System, motion: Motion) -> Float[Tensor, "T 333"]:
    rotmat = motion.local_rotations()
    if system.config.rotation_space == "global":
        rotmat = global_from_local(rotmat)
    return pack(rot6d_from_matrix(rotmat), torch.from_numpy(motion.trans.copy()))


def _positions(system: System, vectors: Float[Tensor, "*batch 333"]) -> Float[Tensor, "_ T 55 3"]:
    rotmat = matrix_from_rot6d(unpack(vectors)[0])
    if system.config.rotation_space == "local":
        rotmat = global_from_local(rotmat)
    return joint_positions_from_global(rotmat, open_body_skeleton())


def frame_loudness(
    waveform: Float[np.ndarray, " N"], num_frames: int
) -> Float[np.ndarray, " num_frames"]:
    """Level of each motion frame in dB, not below -60 dB of full scale; silence after the end."""
    edges = (np.arange(num_frames + 1) * SAMPLE_RATE / FPS).astype(int)
    energy = np.concatenate([[0.0], np.cumsum(waveform.astype(np.float64) ** 2)])
    total = np.diff(energy[edges.clip(max=len(waveform))])
    return 10 * np.log10(total / np.diff(edges) + 1e-6)


def coupling(positions: Float[np.ndarray, "T 55 3"], loudness: Float[np.ndarray, " T2"]) -> float:
    """How far the speed of the wrists goes with the loudness of speech: their correlation at the
    best lag within half a second, both smoothed over 0.3 s. The choice of the lag raises it above
    0 for any two signals: compare with shifted speech.
    """
    speed = np.linalg.norm(np.diff(positions[:, _WRISTS], axis=0), axis=-1).sum(-1) * FPS
    frames = min(len(speed), len(loudness))
    box = np.ones(SMOOTHING_FRAMES) / SMOOTHING_FRAMES
    a = np.convolve(speed[:frames], box, "valid")
    b = np.convolve(loudness[:frames], box, "valid")
    lags = range(-round(MAX_LAG_S * FPS), round(MAX_LAG_S * FPS) + 1)
    return max(_correlation(a, b, lag) for lag in lags)


def _correlation(a: np.ndarray, b: np.ndarray, lag: int) -> float:
    a, b = (a[lag:], b[: len(b) - lag]) if lag >= 0 else (a[:lag], b[-lag:])
    if len(a) < 2 or a.std() == 0 or b.std() == 0:
        return 0.0
    return float(np.corrcoef(a, b)[0, 1])
