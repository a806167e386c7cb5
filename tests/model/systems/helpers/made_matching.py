"""A small judge, trained in seconds on made speech whose loudness is how fast the arms turn."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from scipy.ndimage import gaussian_filter1d

from conventions.joints import JOINT_INDEX
from model.data.prepared import PreparedClip, PreparedData
from model.motion.motion import Motion
from model.networks.config import MatchingConfig
from model.storage.checkpoint import save_weights
from model.systems.helpers.config import MATCHING_NETWORK, MatchingTrainConfig, presets
from model.systems.helpers.task import make_task
from model.training.task import SingleNetworkTask, TaskSetup
from tests.helpers import smooth_motion_example

SHAPE = MatchingConfig(speech_width=16, motion_width=16, dilations=(1, 2), track_dim=4)
ARMS = [
    3 * JOINT_INDEX[f"{side}_{j}"] + 2 for side in ("left", "right") for j in ("shoulder", "elbow")
]


def tiny_config(**changes) -> MatchingTrainConfig:
    config = presets(MATCHING_NETWORK)["smoke"]
    return replace(config, matching=SHAPE, augment_speech=False, **changes)


def made_envelope(num_frames: int, seed: int) -> np.ndarray:
    """Loud and soft, -1 to 1, changing about twice a second."""
    noise = np.random.default_rng(seed).standard_normal(num_frames)
    return np.tanh(2 * gaussian_filter1d(noise, 5) / 0.24)


def made_features(envelope: np.ndarray) -> np.ndarray:
    """As loud in all mels and always voiced."""
    features = np.repeat(envelope[:, None], 68, axis=1)
    features[:, 65:67] = 0.0
    features[:, 67] = 1.0
    return features.astype(np.float32)


def made_poses(envelope: np.ndarray) -> np.ndarray:
    """Arms that turn at 1 to 3 rad/s, the faster the louder; all else is still."""
    poses = np.zeros((len(envelope), 165), np.float32)
    poses[:, ARMS] = np.cumsum(2 + envelope)[:, None] / 30
    return poses


def made_motion(envelope: np.ndarray) -> Motion:
    return replace(smooth_motion_example(len(envelope)), poses=made_poses(envelope))


def made_data(folder: Path, num_frames: int = 1200, count: int = 6) -> PreparedData:
    """Clips of which the last is for validation."""
    envelopes = [made_envelope(num_frames, seed) for seed in range(count)]
    splits = ["train"] * (count - 1) + ["val"]
    clips = [
        PreparedClip(f"1_ann_0_{k}_{k}", 1, split, k * num_frames, num_frames)
        for k, split in enumerate(splits)
    ]
    rows = count * num_frames
    return PreparedData(
        folder,
        folder,
        clips=tuple(clips),
        poses=np.concatenate([made_poses(envelope) for envelope in envelopes]),
        transl=np.zeros((rows, 3), np.float32),
        arkit_weights=np.zeros((rows, 52), np.float32),
        speech=np.concatenate([made_features(envelope) for envelope in envelopes]),
        speaker_names={1: "ann"},
    )


def trained(folder: Path, steps: int = 40) -> tuple[SingleNetworkTask, PreparedData]:
    """A task after some steps on such data."""
    config = tiny_config(steps=steps, learning_rate=1e-2, batch_size=8, ema_decay=0.9)
    data = made_data(folder)
    task = make_task(config, data, TaskSetup(folder))
    for step in range(steps):
        rng = np.random.default_rng(step)
        batch = data.draw_windows(data.clips_of_split("train"), task.window_frames, 8, rng)
        task.step(step, batch, torch.Generator().manual_seed(step))
    return task, data


def make_judge(folder: Path) -> None:
    """The files of a trained judge."""
    task, _ = trained(folder)
    card = {"config": {"matching": vars(SHAPE)}, "speakers": {}}
    save_weights(folder, MATCHING_NETWORK, task.export(), card)
