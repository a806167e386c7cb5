"""One training from the first step to the last: prepare, step, validate, save.

Every random draw of a step follows from the step's number, so a run that was stopped and resumed
equals one that was not.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import torch
from torch import Tensor
from tqdm import tqdm

from model.data.prepared import PreparedData, prepare
from model.speech.encoders import make_encoder
from model.storage.cards import load_card
from model.storage.checkpoint import save_weights
from model.training.config import TrainConfig
from model.training.parallel import WHOLE, Shard
from model.training.run_folder import (
    History,
    TrainingError,
    make_card,
    open_run,
    origin_of,
    restore_state,
    save_state,
)
from model.training.task import Start, Task, TaskSetup

VALIDATION_BATCHES = 8

MakeTask = Callable[[TrainConfig, PreparedData, TaskSetup], Task]


def train(
    config: TrainConfig,
    make_task: MakeTask,
    data_folder: Path,
    out: Path,
    *,
    helpers: Path,
    resume: bool = False,
    start: Start | None = None,
    shard: Shard = WHOLE,
    may_compile: bool = False,
) -> None:
    """Run or resume one training; leaves ``out/state.pt``, ``log.csv`` and ``out/weights/``.

    Args:
        make_task: of the family that ``config`` belongs to.
        helpers: folder with the weights of networks that the task needs and does not train.
        may_compile: compile the step where that works; it starts a minute or two later then.

    Raises:
        TrainingError: if ``out`` holds another run, or there is none to resume.
        DataError: if the data folder cannot be used.
        FloatingPointError: if the loss is no number; the last saved state is kept.
    """
    if config.batch_size % shard.count:
        raise TrainingError(
            f"batch_size is {config.batch_size}; it must be a multiple of the {shard.count} "
            "processes."
        )
    encoder = make_encoder(config.encoder)
    with shard.first_alone():
        data = prepare(
            data_folder,
            out.parent / f"prepared-{encoder.name}",
            encoder,
            augmented_copies=config.augmented_copies,
        )
    train_clips, val_clips = data.of_split("train"), data.of_split("val")
    with shard.first_alone():
        if shard.is_first:
            open_run(config, out, resume)
    origin = start and origin_of(start)
    if resume:  # what the run began with is told by what it saved, not by this command
        start = Start(out / "weights", config.system)
        origin = load_card(start.folder, start.system)["started_from"]
    with shard.first_alone():
        task = make_task(config, data, TaskSetup(helpers, start, shard, may_compile))
    first = restore_state(out, task) if resume else 0
    history = History(out / "log.csv", keep_below=first)
    progress = tqdm(range(first, config.steps), initial=first, total=config.steps, unit="step",
                    disable=not shard.is_first)  # fmt: skip
    for step in progress:
        rng = np.random.default_rng([config.random_seed, step])
        generator = torch.Generator().manual_seed(int(rng.integers(2**62)))
        batch = data.window_batch(
            train_clips, task.window_frames, config.batch_size, rng, task.context
        )
        history.add(step, task.step(step, batch, generator))
        done = step + 1
        last = done == config.steps
        if last or done % config.validate_every == 0:
            sums: dict[str, Tensor] = {}
            for k in range(VALIDATION_BATCHES):  # the same every time
                rng = np.random.default_rng([k, 91])
                batch = data.window_batch(
                    val_clips, task.window_frames, config.batch_size, rng, task.context
                )
                parts = task.validate(batch, torch.Generator().manual_seed(k))
                sums = {name: sums.get(name, 0.0) + value for name, value in parts.items()}
            means = {name: total / VALIDATION_BATCHES for name, total in shard.mean(sums).items()}
            history.add_validation(step, means)
            progress.set_postfix(val=f"{means['total']:.4f}")
        if shard.is_first and (last or done % config.save_every == 0):
            history.flush()
            card = make_card(config, data, data_folder, done, history.last_validation, origin)
            save_weights(out / "weights", config.system, task.export(), card)
            save_state(out, done, task)  # last: it needs the weights
    shard.wait()
