"""Train a network: ``python -m model.train CONFIG --data DIR --out DIR [--system NAME]``.

Reads top to bottom: prepare the data, build the network, step, keep an average of the weights,
validate on the validation split, save. Every random draw of a step follows from the step's number,
so a run that was stopped and resumed equals one that was not.
"""

import argparse
import dataclasses
import logging
import math
import sys
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn
from tqdm import tqdm

from model.data.prepared import Batch, DataError, prepare, validation_batches
from model.speech.encoders import make_encoder
from model.storage.cards import BUNDLED_WEIGHTS, CheckpointError, load_card
from model.storage.checkpoint import save_weights
from model.storage.settings import TrainConfig
from model.systems.globaldiff.config import CONFIGS, SYSTEMS, named_config
from model.training import losses
from model.training.card import make_card, origin_of
from model.training.parallel import WHOLE, Shard, joined_processes
from model.training.rate import can_compile
from model.training.run_folder import History, TrainingError, open_run, restore_state, save_state
from model.training.task import Start, Task, make_task

VALIDATION_BATCHES = 8


def main(arguments: list[str] | None = None) -> int:
    """The command; returns its exit status."""
    parser = argparse.ArgumentParser(prog="python -m model.train", description=__doc__)
    parser.add_argument("config", help=f"one of {', '.join(CONFIGS)}")
    parser.add_argument("--data", type=Path, required=True, help="folder in BEAT2's layout")
    parser.add_argument("--out", type=Path, required=True, help="folder for state and weights")
    parser.add_argument(
        "--system", default="globaldiff/global",
        help="a rung of the ladder; or: expression, motion-vae, fgd-encoder",
    )  # fmt: skip
    parser.add_argument("--steps", type=int, help="instead of the config's number")
    parser.add_argument(
        "--helpers", type=Path, default=BUNDLED_WEIGHTS, metavar="DIR",
        help="folder with the weights of L_m's encoder",
    )  # fmt: skip
    parser.add_argument(
        "--start-from", type=Path, metavar="DIR",
        help="begin with the weights of this folder and a fresh optimizer",
    )  # fmt: skip
    parser.add_argument(
        "--start-system", metavar="NAME", help="whose weights of that folder; --system if not given"
    )
    parser.add_argument("--random-seed", type=int, default=0, help="another training of its kind")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--fp32", action="store_true", help="no bf16 even where it is faster")
    parser.add_argument("--no-compile", action="store_true", help="never compile the step")
    parser.add_argument("--resume", action="store_true", help="go on from the state in --out")
    args = parser.parse_args(arguments)
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    torch.set_num_threads(args.threads)
    try:
        config = named_config(args.config, args.system)
        config = dataclasses.replace(config, random_seed=args.random_seed)
        if args.steps is not None:
            config = dataclasses.replace(config, steps=args.steps)
        start = args.start_from and Start(args.start_from, args.start_system or args.system)
        with joined_processes() as shard:
            shard = dataclasses.replace(shard, bf16=not args.fp32)
            train(config, args.data, args.out, resume=args.resume, helpers=args.helpers,
                  start=start, shard=shard, may_compile=not args.no_compile)  # fmt: skip
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
    helpers: Path = BUNDLED_WEIGHTS,
    start: Start | None = None,
    shard: Shard = WHOLE,
    may_compile: bool = False,
) -> None:
    """Run or resume one training; leaves ``out/state.pt``, ``log.csv`` and ``out/weights/``.

    Args:
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
    window = config.network.window_frames
    with shard.first_alone():
        if shard.is_first:
            open_run(config, out, resume)
    origin = start and origin_of(start)
    if resume:  # what the run began with is told by what it saved, not by this command
        start = Start(out / "weights", config.system)
        origin = load_card(start.folder, start.system)["started_from"]
    compile_step = may_compile and config.system in SYSTEMS and can_compile()
    with shard.first_alone():
        task = make_task(config, data, helpers, start, shard.device, compile_step)
    network = task.network
    average = torch.optim.swa_utils.AveragedModel(
        network, multi_avg_fn=torch.optim.swa_utils.get_ema_multi_avg_fn(config.ema_decay)
    )
    optimizer = torch.optim.AdamW(
        network.parameters(), lr=config.learning_rate, weight_decay=config.weight_decay, fused=True
    )
    first = restore_state(out, network, average, optimizer) if resume else 0
    if compile_step:
        network.compile(dynamic=False)
    parallel = shard.wrap(network)
    history = History(out / "log.csv", keep_below=first)
    progress = tqdm(range(first, config.steps), initial=first, total=config.steps, unit="step",
                    disable=not shard.is_first)  # fmt: skip
    for step in progress:
        for group in optimizer.param_groups:
            group["lr"] = config.learning_rate * learning_rate_factor(step, config)
        rng = np.random.default_rng([config.random_seed, step])
        generator = torch.Generator().manual_seed(int(rng.integers(2**62)))
        batch = data.window_batch(
            train_clips, window, config.batch_size, rng, config.mirror, task.context
        )
        network.train()
        loss = task.step_loss(parallel, batch, generator, shard)
        optimizer.zero_grad(set_to_none=True)
        loss.total.backward()
        norm = nn.utils.clip_grad_norm_(network.parameters(), config.clip_norm)
        numbers = shard.mean(loss.parts | {"gradient_norm": norm})
        losses.finite_or_raise(numbers, step, batch.clips)
        optimizer.step()
        if step < 2 * config.warmup_steps:  # average only what has left the start behind
            average.module.load_state_dict(network.state_dict())
        else:
            average.update_parameters(network)
        history.add(step, numbers)
        done = step + 1
        last = done == config.steps
        if last or done % config.validate_every == 0:
            batches = validation_batches(
                data, val_clips, window, config.batch_size, VALIDATION_BATCHES, task.context
            )
            validation = _validate(task, average.module, batches, shard)
            history.add_validation(step, validation)
            progress.set_postfix(val=f"{validation['total']:.4f}")
        if shard.is_first and (last or done % config.save_every == 0):
            history.flush()
            card = make_card(config, data, data_folder, done, history.last_validation, origin)
            save_weights(out / "weights", config.system, task.tensors(average.module), card)
            save_state(out, done, network, average, optimizer)  # last: it needs the weights
    shard.wait()


def learning_rate_factor(step: int, config: TrainConfig) -> float:
    """Linear warm-up, then a cosine from 1 down to 0.02."""
    if step < config.warmup_steps:
        return (step + 1) / config.warmup_steps
    done = (step - config.warmup_steps) / max(1, config.steps - config.warmup_steps)
    return 0.02 + 0.98 * (1 + math.cos(math.pi * done)) / 2


@torch.no_grad()
def _validate(
    task: Task, network: nn.Module, batches: Iterable[Batch], shard: Shard
) -> dict[str, float]:
    network.eval()
    sums: dict[str, Tensor] = {}
    for k, batch in enumerate(batches):
        parts = task.step_loss(network, batch, torch.Generator().manual_seed(k), shard).parts
        sums = {name: sums.get(name, 0.0) + value for name, value in parts.items()}
    return {name: total / VALIDATION_BATCHES for name, total in shard.mean(sums).items()}


if __name__ == "__main__":
    sys.exit(main())
