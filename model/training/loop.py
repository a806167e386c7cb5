"""Training loop: prepare, step, validate, save; and the run folder.

Every random draw of a step follows from the step's number, so a run that was stopped and resumed
equals one that was not.
"""

import csv
import datetime
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor
from tqdm import tqdm

from conventions.rates import FPS
from model.data.prepared import Batch, PreparedClip, PreparedData, prepare
from model.speech.encoders import make_encoder
from model.storage.cards import BUNDLED_WEIGHTS, load_card, to_json
from model.storage.checkpoint import save_weights
from model.storage.escaping import csv_text
from model.storage.files import write_atomically, written_atomically
from model.storage.revision import revision
from model.training.config import TrainConfig
from model.training.parallel import UNSHARDED, Shard
from model.training.task import Task, TaskSetup

STATE_FILE = "state.pt"


class TrainingError(ValueError):
    """Error for a run that cannot start, resume or continue; the message gives the reason."""


class History:
    """Rows of log.csv; those of single steps are averaged between flushes."""

    def __init__(self, path: Path, keep_below: int) -> None:
        self.path = path
        self.pending: list[dict[str, float]] = []
        self.rows: list[dict[str, Any]] = []
        if keep_below and path.is_file():
            with path.open(newline="") as file:
                self.rows = [r for r in csv.DictReader(file) if int(r["step"]) <= keep_below]

    def flush(self, step: int) -> None:
        names = self.pending[0]
        mean = {n: float(np.mean([p[n] for p in self.pending])) for n in names}
        self.rows.append({"step": step, "split": "train", **mean})
        self.pending = []
        columns = list(dict.fromkeys(name for row in self.rows for name in row))
        rows = [columns, *([row.get(name) for name in columns] for row in self.rows)]
        write_atomically(self.path, csv_text(rows))


def open_run(config: TrainConfig, out: Path, resume: bool) -> None:
    """Start a run in ``out``, or check that it can be resumed; raises TrainingError."""
    out.mkdir(parents=True, exist_ok=True)
    config_path, state_path = out / "config.json", out / STATE_FILE
    if not resume:
        if state_path.exists():
            raise TrainingError(f"{out} holds a run already; pass --resume or another --out.")
        write_atomically(config_path, to_json(config) + "\n")
        return
    if not state_path.is_file():
        raise TrainingError(f"There is no {state_path} to resume from.")
    differing = differing_fields(json.loads(config_path.read_text()), json.loads(to_json(config)))
    if differing:
        raise TrainingError(
            f"{out} was started with other settings ({', '.join(differing)}); "
            "resume with the same ones or choose another --out."
        )


def differing_fields(a: dict, b: dict, prefix: str = "") -> list[str]:
    """Return dotted names of the settings in which two parsed configs differ."""
    names: list[str] = []
    for key in sorted(set(a) | set(b)):
        one, other = a.get(key), b.get(key)
        if isinstance(one, dict) and isinstance(other, dict):
            names += differing_fields(one, other, f"{prefix}{key}.")
        elif one != other:
            names.append(prefix + key)
    return names


def make_card(
    config: TrainConfig, data: PreparedData, folder: Path, steps: int, validation: dict,
    origin: dict[str, Any] | None, is_bundled: bool,
) -> dict[str, Any]:  # fmt: skip
    """Return the card of the weights after some steps.

    ``origin`` identifies the weights that the training started from, and ``is_bundled`` says
    whether those were the bundled ones.
    """
    corpus = folder / "corpus.json"
    train_clips = data.clips_of_split("train")
    speakers = {clip.speaker for clip in train_clips}
    train_frames = sum(clip.num_frames for clip in train_clips if clip.copy == 0)
    return {
        "config": json.loads(to_json(config)),
        "speakers": {name: n for n, name in sorted(data.speaker_names.items()) if n in speakers},
        "training_data": json.loads(corpus.read_text()) if corpus.is_file() else folder.name,
        "training_hours": round(train_frames / FPS / 3600, 3),
        "steps": steps,
        "started_from_bundled_weights": is_bundled,
        "started_from": origin,
        "validation": {name: round(value, 6) for name, value in validation.items()},
        "date": datetime.date.today().isoformat(),
        "revision": revision(),
    }


VALIDATION_BATCHES = 8

MakeTask = Callable[[TrainConfig, PreparedData, TaskSetup], Task]


def train(
    config: TrainConfig,
    make_task: MakeTask,
    data_folder: Path,
    out: Path,
    *,
    helper_weights: Path,
    resume: bool = False,
    initial_weights: Path | None = None,
    shard: Shard = UNSHARDED,
    may_compile: bool = False,
) -> None:
    """Run or resume one training; writes ``out/state.pt``, ``log.csv`` and ``out/weights/``.

    Args:
        make_task: function of the family that ``config`` belongs to.
        helper_weights: folder with the weights of networks that the task needs and does not train.
        initial_weights: folder with weights of the same name to start from.
        may_compile: compile the step if that works; the first step then takes a minute or two more.

    Raises:
        TrainingError: if ``out`` holds another run, or there is none to resume.
        DataError: if the data folder cannot be used.
        FloatingPointError: if the loss is not finite; the last saved state remains.
    """
    if config.batch_size % shard.count:
        raise TrainingError(
            f"batch_size is {config.batch_size}; it must be a multiple of the number of "
            f"processes ({shard.count})."
        )
    encoder = make_encoder(config.encoder)
    with shard.first_process_first():
        data = prepare(
            data_folder,
            out.parent / f"prepared-{encoder.name}",
            encoder,
            augmented_copies=config.augmented_copies,
        )
    train_clips, val_clips = data.clips_of_split("train"), data.clips_of_split("val")
    with shard.first_process_first():
        if shard.is_first:
            open_run(config, out, resume)
    origin, is_bundled = None, False
    if resume:  # the origin of a resumed run is in its weights, not this command
        initial_weights = out / "weights"
        card = load_card(initial_weights, config.system)
        origin, is_bundled = card["started_from"], card["started_from_bundled_weights"]
    elif initial_weights is not None:
        card = load_card(initial_weights, config.system)
        origin = {"system": config.system, "sha256": card.sha256, "steps": card.training_steps}
        is_bundled = initial_weights.resolve() == BUNDLED_WEIGHTS.resolve()
    with shard.first_process_first():
        task = make_task(
            config, data, TaskSetup(helper_weights, initial_weights, shard, may_compile)
        )
    first = 0
    if resume:
        state = torch.load(out / STATE_FILE, weights_only=True, map_location="cpu")
        task.restore(state)
        first = int(state["step"])
    history, means = History(out / "log.csv", keep_below=first), {}

    def batch_of(clips: tuple[PreparedClip, ...], rng: np.random.Generator) -> Batch:
        size = config.batch_size
        return data.draw_windows(clips, task.window_frames, size, rng, task.context_frames)

    progress = tqdm(range(first, config.steps), initial=first, total=config.steps, unit="step",
                    disable=not shard.is_first)  # fmt: skip
    for step in progress:
        rng = np.random.default_rng([config.random_seed, step])
        generator = torch.Generator().manual_seed(int(rng.integers(2**62)))
        history.pending.append(task.step(step, batch_of(train_clips, rng), generator))
        done = step + 1
        last = done == config.steps
        if last or done % config.validate_every == 0:
            sums: dict[str, Tensor] = {}
            for k in range(VALIDATION_BATCHES):  # the same every time
                batch = batch_of(val_clips, np.random.default_rng([k, 91]))
                parts = task.validate(batch, torch.Generator().manual_seed(k))
                sums = {name: sums.get(name, 0.0) + value for name, value in parts.items()}
            means = {name: total / VALIDATION_BATCHES for name, total in shard.mean(sums).items()}
            history.rows.append({"step": done, "split": "val", **means})
            progress.set_postfix(val=f"{means['total']:.4f}")
        if shard.is_first and (last or done % config.save_every == 0):
            history.flush(done)
            card = make_card(config, data, data_folder, done, means, origin, is_bundled)
            save_weights(out / "weights", config.system, task.export(), card)
            with written_atomically(out / STATE_FILE) as path:  # last: it needs the weights
                torch.save({"step": done, **task.state()}, path)
    shard.wait()
