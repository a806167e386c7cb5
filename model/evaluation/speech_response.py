"""Does motion follow its speech? The wrong-speech test, on predictions and on finished motion."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from model.motion.decoding import decode, to_vectors
from model.motion.motion import Motion
from model.motion.skeleton import JOINT_DEPTH, JOINT_INDEX, open_body_skeleton
from model.motion.timing import FPS, SAMPLE_RATE
from model.sampling.flow import interpolate
from model.systems.base import System

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

    face = system.face
    face_noise = torch.cat([face.noise(0, index) for index in range(len(x_1))])

    def heard(track: Features, context: int) -> Float[Tensor, "windows heard dim"]:
        rows = np.arange(-context, window + context) + np.array(starts)[:, None]
        return torch.from_numpy(track[rows.clip(0, len(track) - 1)])

    def drawn(track: Features) -> Float[Tensor, "windows T E"]:
        speech = heard(track, face.config.speech_context)
        parts = [
            face.draw(speech[rows], speaker, None, face_noise[rows])[0]
            for rows in (slice(k, k + batch_size) for k in range(0, len(x_1), batch_size))
        ]
        return torch.cat(parts)

    faces = {kind: drawn(track) for kind, track in tracks.items()}

    def predictions(kind: str, time: float) -> Float[Tensor, "windows T C"]:
        speech = heard(tracks[kind], config.speech_context)
        parts = []
        for first in range(0, len(x_1), batch_size):
            rows = slice(first, first + batch_size)
            size = len(x_1[rows])
            t = torch.full((size,), time)
            parts.append(
                system.network(
                    interpolate(x_0[rows], x_1[rows], t),
                    t,
                    speech=speech[rows],
                    expression=faces[kind][rows],
                    seed=torch.zeros(size, config.seed_frames, x_1.shape[-1]),
                    speaker=torch.full((size,), speaker),
                    has_seed=torch.zeros(size, dtype=torch.bool),
                    has_speech=torch.ones(size, dtype=torch.bool),
                )
            )
        return torch.cat(parts)

    def scaled(x: Tensor) -> Tensor:
        return system.normaliser.scaled(system.normaliser.restore(x))

    wanted = scaled(x_1)
    for kind in tracks:
        found = [scaled(predictions(kind, time)) for time in FLOW_TIMES]
        at_times = [(one - wanted).square().mean() for one in found]
        errors[kind] = float(torch.stack(at_times).mean())
    late = system.normaliser.restore(predictions("right", DEPTH_FLOW_TIME))
    distance = (_positions(system, late) - _positions(system, system.normaliser.restore(x_1))).norm(
        dim=-1
    )
    by_joint = distance.mean((0, 1)).numpy()
    depth = np.array(JOINT_DEPTH)
    by_depth = [float(by_joint[depth == d].mean()) for d in range(max(JOINT_DEPTH) + 1)]
    return Prediction(errors, by_depth)


def _vectors(system: System, motion: Motion) -> Float[Tensor, "T C"]:
    config = system.config
    transl = torch.from_numpy(motion.trans.astype(np.float32))
    if config.root == "place":
        transl = transl - transl.mean(0) * torch.tensor([1.0, 0.0, 1.0])
    poses = torch.from_numpy(motion.poses.astype(np.float32))
    return to_vectors(config.rotation_space, poses[None], transl[None], config.root)[0]


def _positions(system: System, vectors: Float[Tensor, "windows T C"]) -> Float[Tensor, "_ T 55 3"]:
    config = system.config
    return decode(vectors, config.rotation_space, open_body_skeleton(), config.root).rooted


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
