"""Train a network: ``python -m model.train CONFIG --data DIR --out DIR [--system NAME]``.

Reads top to bottom: prepare the data, build the network, step, keep an average of the weights,
validate on the validation split, save. Every random draw of a step follows from the step's number,
so a run that was stopped and resumed equals one that was not.
"""

import argparse
import csv
import dataclasses
import datetime
import json
import logging
import math
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn
from tqdm import tqdm

from model import losses
from model.cards import BUNDLED_WEIGHTS, CheckpointError
from model.checkpoint import load_into, load_weights, save_weights
from model.config import ExpressionConfig, TrainConfig, from_dict, named_config, to_json
from model.data import Batch, DataError, PreparedData, prepare, validation_batches
from model.expression import ExpressionNetwork, predict_expressions
from model.files import written_atomically
from model.flow import interpolate, time_weight
from model.kinematics import global_from_local, joint_positions_from_global
from model.network import MotionNetwork
from model.packing import Normaliser, pack, unpack
from model.rotations import matrix_from_axis_angle, matrix_from_rot6d, rot6d_from_matrix
from model.skeleton import open_body_skeleton
from model.speech.encoders import make_encoder
from model.speech.features import augment_mel

log = logging.getLogger(__name__)

VALIDATION_BATCHES = 8


class TrainingError(ValueError):
    """A run that cannot start, resume or go on; the message says why."""


@dataclass(frozen=True)
class StepLoss:
    """The loss to descend, and its parts for the log."""

    total: Float[Tensor, ""]
    parts: dict[str, float]


StepFunction = Callable[[nn.Module, Batch, torch.Generator], StepLoss]


def main(arguments: list[str] | None = None) -> int:
    """The command; returns its exit status."""
    parser = argparse.ArgumentParser(prog="python -m model.train", description=__doc__)
    parser.add_argument("config", help="demo or smoke")
    parser.add_argument("--data", type=Path, required=True, help="folder in BEAT2's layout")
    parser.add_argument("--out", type=Path, required=True, help="folder for state and weights")
    parser.add_argument("--system", default="globaldiff/global", help="or: expression")
    parser.add_argument("--steps", type=int, help="instead of the config's number")
    parser.add_argument(
        "--expression", type=Path, default=BUNDLED_WEIGHTS, metavar="DIR",
        help="folder with the expression network's weights",
    )  # fmt: skip
    parser.add_argument(
        "--start-from", type=Path, metavar="DIR",
        help="begin with the weights of this folder and a fresh optimizer",
    )  # fmt: skip
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--resume", action="store_true", help="go on from the state in --out")
    args = parser.parse_args(arguments)
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    torch.set_num_threads(args.threads)
    try:
        config = named_config(args.config, args.system)
        if args.steps is not None:
            config = dataclasses.replace(config, steps=args.steps)
        train(config, args.data, args.out, resume=args.resume, expression_folder=args.expression,
              start_from=args.start_from)  # fmt: skip
    except (TrainingError, DataError, CheckpointError, ValueError) as error:
        sys.stderr.write(f"{error}\n")
        return 1
    except (FloatingPointError, OSError) as error:
        sys.stderr.write(f"Training stopped: {error} The last saved state is kept.\n")
        return 1
    return 0


def train(
    config: TrainConfig,
    data_folder: Path,
    out: Path,
    *,
    resume: bool = False,
    expression_folder: Path = BUNDLED_WEIGHTS,
    start_from: Path | None = None,
) -> None:
    """Run or resume one training; leaves ``out/state.pt``, ``log.csv`` and ``out/weights/``.

    Raises:
        TrainingError: if ``out`` holds another run, or there is none to resume.
        DataError: if the data folder cannot be used.
        FloatingPointError: if the loss is no number; the last saved state is kept.
    """
    encoder = make_encoder(config.encoder)
    data = prepare(data_folder, out.parent / f"prepared-{encoder.name}", encoder)
    train_clips, val_clips = data.of_split("train"), data.of_split("val")
    window = config.network.window_frames
    torch.manual_seed(config.random_seed)
    if config.system == "expression":
        network: nn.Module = ExpressionNetwork(config.expression)
        step_loss = expression_step(config)
        extra: dict[str, Tensor] = {}
    else:
        normaliser = fit_normaliser(config, data)
        expressions = _predicted_expressions(data, expression_folder)
        network = MotionNetwork(config.network)
        step_loss = motion_step(config, normaliser, expressions)
        extra = {"normaliser.mean": normaliser.mean, "normaliser.std": normaliser.std}
    if start_from is not None:
        tensors, _ = load_weights(start_from, config.system)
        load_into(network, tensors, "network.", config.system)
    average = torch.optim.swa_utils.AveragedModel(
        network, multi_avg_fn=torch.optim.swa_utils.get_ema_multi_avg_fn(config.ema_decay)
    )
    optimizer = torch.optim.AdamW(
        network.parameters(), lr=config.learning_rate, weight_decay=config.weight_decay, fused=True
    )
    first = _open_run(config, out, resume, network, average, optimizer)
    history = _History(out / "log.csv", keep_below=first)
    progress = tqdm(range(first, config.steps), initial=first, total=config.steps, unit="step")
    for step in progress:
        for group in optimizer.param_groups:
            group["lr"] = config.learning_rate * learning_rate_factor(step, config)
        rng = np.random.default_rng([config.random_seed, step])
        generator = torch.Generator().manual_seed(int(rng.integers(2**62)))
        batch = data.window_batch(train_clips, window, config.batch_size, rng)
        network.train()
        loss = step_loss(network, batch, generator)
        losses.finite_or_raise(loss.total, step, batch.clips)
        optimizer.zero_grad(set_to_none=True)
        loss.total.backward()
        nn.utils.clip_grad_norm_(network.parameters(), config.clip_norm)
        optimizer.step()
        if step < 2 * config.warmup_steps:  # average only what has left the start behind
            average.module.load_state_dict(network.state_dict())
        else:
            average.update_parameters(network)
        history.add(step, loss.parts)
        done = step + 1
        last = done == config.steps
        if last or done % config.validate_every == 0:
            validation = _validate(average.module, step_loss, data, val_clips, window, config)
            history.add_validation(step, validation)
            progress.set_postfix(val=f"{validation['total']:.4f}")
        if last or done % config.save_every == 0:
            history.flush()
            _save_state(out, config, done, network, average, optimizer)
            tensors = {f"network.{k}": v for k, v in average.module.state_dict().items()} | extra
            card = _card(config, data, data_folder, done, history.last_validation, start_from)
            save_weights(out / "weights", config.system, tensors, card)


def learning_rate_factor(step: int, config: TrainConfig) -> float:
    """Linear warm-up, then a cosine from 1 down to 0.02."""
    if step < config.warmup_steps:
        return (step + 1) / config.warmup_steps
    done = (step - config.warmup_steps) / max(1, config.steps - config.warmup_steps)
    return 0.02 + 0.98 * (1 + math.cos(math.pi * done)) / 2


def to_vectors(config: TrainConfig, batch: Batch) -> Float[Tensor, "B T 333"]:
    """Motion vectors of a batch in the config's rotation space, not normalised."""
    rotmat = matrix_from_axis_angle(batch.poses.unflatten(-1, (-1, 3)))
    if config.network.rotation_space == "global":
        rotmat = global_from_local(rotmat)
    return pack(rot6d_from_matrix(rotmat), batch.transl)


def fit_normaliser(config: TrainConfig, data: PreparedData) -> Normaliser:
    """Statistics over (at most 400 windows of) the training split."""
    rng = np.random.default_rng(0)
    window = config.network.window_frames
    batch = data.window_batch(data.of_split("train"), window, 400, rng)
    return Normaliser.fit(to_vectors(config, batch).flatten(0, 1))


def motion_step(
    config: TrainConfig, normaliser: Normaliser, expressions: Float[Tensor, "N E"]
) -> StepFunction:
    """The loss of a motion network on one batch."""
    skeleton = open_body_skeleton()
    space, weights = config.network.rotation_space, config.loss
    seed_frames = config.network.seed_frames

    def positions(vectors: Float[Tensor, "B T 333"]) -> Float[Tensor, "B T 55 3"]:
        rot6d, transl = unpack(vectors)
        rotmat = matrix_from_rot6d(rot6d)
        global_rot = global_from_local(rotmat) if space == "local" else rotmat
        return joint_positions_from_global(global_rot, skeleton, transl)

    def step(network: nn.Module, batch: Batch, generator: torch.Generator) -> StepLoss:
        size = len(batch.clips)

        def keep(dropout: float) -> Bool[Tensor, " B"]:
            return torch.rand(size, generator=generator) >= dropout

        with torch.no_grad():
            vectors = to_vectors(config, batch)
            target_positions = positions(vectors)
            x_1 = normaliser.normalise(vectors)
            x_0 = torch.randn(x_1.shape, generator=generator)
            t = torch.rand(size, generator=generator)
            speech = batch.speech
            if network.training and config.augment_speech:
                speech = augment_mel(speech, generator)
            has_seed = keep(config.seed_dropout)
            speaker = batch.speaker * keep(config.speaker_dropout)
        predicted = network(
            interpolate(x_0, x_1, t),
            t,
            speech=speech,
            expression=expressions[torch.from_numpy(batch.frames)],
            seed=x_1[:, :seed_frames],
            speaker=speaker,
            has_seed=has_seed,
            has_speech=keep(config.speech_dropout),
        )
        predicted_positions = positions(normaliser.restore(predicted))
        seed_error = losses.simple_loss(predicted[:, :seed_frames], x_1[:, :seed_frames])
        terms = {
            "simple": weights.simple * losses.simple_loss(predicted, x_1),
            "position": weights.position
            * losses.position_loss(predicted_positions, target_positions),
            "velocity": weights.velocity
            * losses.velocity_loss(predicted_positions, target_positions),
            "acceleration": weights.acceleration
            * losses.acceleration_loss(predicted_positions, target_positions),
            "seed": weights.seed * seed_frames / x_1.shape[1] * seed_error * has_seed,
        }
        by_sample = time_weight(t, weights.time_weight_floor)
        means = {name: (by_sample * term).mean() for name, term in terms.items()}
        total = torch.stack(list(means.values())).sum()
        parts = {name: float(term.detach()) for name, term in means.items()}
        return StepLoss(total, parts | {"total": float(total.detach())})

    return step


def expression_step(config: TrainConfig) -> StepFunction:
    """The loss of the expression network on one batch."""

    def step(network: nn.Module, batch: Batch, generator: torch.Generator) -> StepLoss:
        speech = batch.speech
        speaker = batch.speaker
        if network.training:
            kept = torch.rand(len(speaker), generator=generator) >= config.speaker_dropout
            speaker = speaker * kept
            if config.augment_speech:
                speech = augment_mel(speech, generator)
        total = losses.expression_loss(network(speech, speaker), batch.expression)
        return StepLoss(total, {"total": float(total.detach())})

    return step


def _predicted_expressions(data: PreparedData, folder: Path) -> Float[Tensor, "N E"]:
    """What the (frozen) expression network says for every frame: what generation will see."""
    tensors, card = load_weights(folder, "expression")
    network = ExpressionNetwork(from_dict(ExpressionConfig, card["config"]["expression"]))
    load_into(network, tensors, "network.", "expression")
    network.eval()
    result = torch.empty(len(data.speech), network.config.expression_dim)
    for clip in data.clips:
        speech = torch.from_numpy(data.speech[clip.start : clip.stop].astype(np.float32))
        result[clip.start : clip.stop] = predict_expressions(network, speech, clip.speaker)
    return result.clone()


@torch.no_grad()
def _validate(
    network: nn.Module,
    step_loss: StepFunction,
    data: PreparedData,
    clips: tuple,
    window: int,
    config: TrainConfig,
) -> dict[str, float]:
    network.eval()
    sums: dict[str, float] = {}
    batches = validation_batches(data, clips, window, config.batch_size, VALIDATION_BATCHES)
    for k, batch in enumerate(batches):
        parts = step_loss(network, batch, torch.Generator().manual_seed(k)).parts
        sums = {name: sums.get(name, 0.0) + value for name, value in parts.items()}
    return {name: value / VALIDATION_BATCHES for name, value in sums.items()}


class _History:
    """Rows of log.csv, averaged between flushes."""

    def __init__(self, path: Path, keep_below: int) -> None:
        self.path = path
        self.pending: list[dict[str, float]] = []
        self.rows: list[dict[str, Any]] = []
        self.last_validation: dict[str, float] = {}
        self.step = keep_below
        if keep_below and path.is_file():
            with path.open(newline="") as file:
                self.rows = [r for r in csv.DictReader(file) if int(r["step"]) <= keep_below]

    def add(self, step: int, parts: dict[str, float]) -> None:
        self.step = step + 1
        self.pending.append(parts)

    def add_validation(self, step: int, parts: dict[str, float]) -> None:
        self.step = step + 1
        self.last_validation = parts
        self.rows.append({"step": self.step, "split": "val", **parts})

    def flush(self) -> None:
        if self.pending:
            names = self.pending[0]
            mean = {n: float(np.mean([p[n] for p in self.pending])) for n in names}
            self.rows.append({"step": self.step, "split": "train", **mean})
            self.pending = []
        columns = list(dict.fromkeys(name for row in self.rows for name in row))
        with written_atomically(self.path) as path, path.open("w", newline="") as file:
            writer = csv.DictWriter(file, columns)
            writer.writeheader()
            writer.writerows(self.rows)


def _open_run(
    config: TrainConfig, out: Path, resume: bool, network: nn.Module, average: nn.Module,
    optimizer: torch.optim.Optimizer,
) -> int:  # fmt: skip
    """The first step to do, with the saved state restored when resuming."""
    out.mkdir(parents=True, exist_ok=True)
    config_path, state_path = out / "config.json", out / "state.pt"
    if not resume:
        if state_path.exists():
            raise TrainingError(f"{out} holds a run already; pass --resume or another --out.")
        config_path.write_text(to_json(config) + "\n")
        return 0
    if not state_path.is_file():
        raise TrainingError(f"There is no {state_path} to resume from.")
    differing = differing_fields(json.loads(config_path.read_text()), json.loads(to_json(config)))
    if differing:
        raise TrainingError(
            f"{out} was started with other settings ({', '.join(differing)}); "
            "resume with the same ones or choose another --out."
        )
    state = torch.load(state_path, weights_only=True)
    network.load_state_dict(state["network"])
    average.load_state_dict(state["average"])
    optimizer.load_state_dict(state["optimizer"])
    return int(state["step"])


def differing_fields(a: dict, b: dict, prefix: str = "") -> list[str]:
    """Dotted names of the settings in which two parsed configs differ."""
    names: list[str] = []
    for key in sorted(set(a) | set(b)):
        one, other = a.get(key), b.get(key)
        if isinstance(one, dict) and isinstance(other, dict):
            names += differing_fields(one, other, f"{prefix}{key}.")
        elif one != other:
            names.append(prefix + key)
    return names


def _save_state(
    out: Path, config: TrainConfig, step: int, network: nn.Module, average: nn.Module,
    optimizer: torch.optim.Optimizer,
) -> None:  # fmt: skip
    state = {
        "step": step,
        "network": network.state_dict(),
        "average": average.state_dict(),
        "optimizer": optimizer.state_dict(),
    }
    with written_atomically(out / "state.pt") as path:
        torch.save(state, path)


def _card(
    config: TrainConfig, data: PreparedData, folder: Path, steps: int, validation: dict,
    start_from: Path | None,
) -> dict[str, Any]:  # fmt: skip
    corpus = folder / "corpus.json"
    train_clips = data.of_split("train")
    seen = {clip.speaker for clip in train_clips}
    train_frames = sum(clip.num_frames for clip in train_clips)
    return {
        "config": json.loads(to_json(config)),
        "speakers": {name: n for n, name in sorted(data.speakers.items()) if n in seen},
        "training_data": json.loads(corpus.read_text()) if corpus.is_file() else folder.name,
        "training_hours": round(train_frames / 30 / 3600, 3),
        "steps": steps,
        "started_from_bundled_weights": start_from is not None,
        "validation": {name: round(value, 6) for name, value in validation.items()},
        "date": datetime.date.today().isoformat(),
        "revision": _revision(),
    }


def _revision() -> str:
    """Git revision of the code, with ``+`` for uncommitted changes; "unknown" without git."""
    root = Path(__file__).parent

    def git(*command: str) -> str:
        return subprocess.run(
            ["git", "-C", str(root), *command], capture_output=True, text=True, check=True
        ).stdout.strip()

    try:
        return git("rev-parse", "--short", "HEAD") + ("+" if git("status", "--porcelain") else "")
    except (OSError, subprocess.CalledProcessError):
        return "unknown"


if __name__ == "__main__":
    sys.exit(main())
