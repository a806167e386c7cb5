"""Training in one or several processes: shards of a batch, their random numbers, and compilation.

``torchrun`` starts the processes; they join over gloo on CPUs and over nccl on GPUs.
"""

import logging
import os
import shutil
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from typing import TypeVar

import torch
import torch.distributed as dist
from jaxtyping import Bool, Float, Shaped
from torch import Tensor, nn

log = logging.getLogger(__name__)
Function = TypeVar("Function", bound=Callable)
CPU = torch.device("cpu")


@dataclass(frozen=True)
class Shard:
    """Share of every batch that one process computes."""

    rank: int = 0
    count: int = 1
    device: torch.device = CPU

    @property
    def is_first(self) -> bool:
        """True if this process writes the files."""
        return self.rank == 0

    @property
    def rows(self) -> slice:
        """Rows of the whole batch for this process."""
        return slice(self.rank, None, self.count)

    def local_rows(self, batch: Shaped[Tensor, "B ..."]) -> Tensor:
        """Return this process's rows of a tensor that holds the whole batch, on its device."""
        return batch[self.rows].to(self.device)

    def autocast(self) -> torch.autocast:
        """Return the autocast context: bf16 for the network on a GPU."""
        is_gpu = self.device.type == "cuda"
        return torch.autocast(self.device.type, torch.bfloat16, enabled=is_gpu)

    def wrap(self, network: nn.Module) -> nn.Module:
        """Wrap a network so that gradients are averaged over all processes."""
        if self.count == 1:
            return network
        ids = [self.device] if self.device.type == "cuda" else None
        return nn.parallel.DistributedDataParallel(network, device_ids=ids, broadcast_buffers=False)

    def mean(self, values: dict[str, Shaped[Tensor, ""]]) -> dict[str, float]:
        """Average each value over all processes."""
        stacked = torch.stack(list(values.values())).double()
        if self.count > 1:
            dist.all_reduce(stacked)
        return dict(zip(values, (stacked / self.count).tolist(), strict=True))

    @contextmanager
    def first_process_first(self) -> Iterator[None]:
        """Run the block in the first process before the others."""
        if not self.is_first:
            self.wait()
        yield
        if self.is_first:
            self.wait()

    def wait(self) -> None:
        """Wait until all processes are here."""
        if self.count > 1:
            dist.barrier()


UNSHARDED = Shard()
"""Shard of a single process on the CPU: whole batches."""


@contextmanager
def joined_processes() -> Iterator[Shard]:
    """Join the processes started by torchrun, and yield this one's shard; on GPUs if available."""
    local_rank = int(os.environ.get("LOCAL_RANK", "0"))
    on_gpu = torch.cuda.is_available()
    device = torch.device("cuda", local_rank) if on_gpu else CPU
    if on_gpu:
        torch.cuda.set_device(device)
    if not dist.is_torchelastic_launched():
        yield Shard(device=device)
        return
    dist.init_process_group("nccl" if on_gpu else "gloo")
    try:
        yield Shard(dist.get_rank(), dist.get_world_size(), device)
        dist.barrier()  # no process leaves while another communicates
    finally:
        dist.destroy_process_group()


@dataclass(frozen=True)
class ShardedRandom:
    """Random numbers for each sample of the whole batch, restricted to the shard's share."""

    batch_size: int
    """Number of samples in the whole batch."""
    generator: torch.Generator
    shard: Shard

    def noise(self, shape: Sequence[int]) -> Float[Tensor, "B ..."]:
        """Draw standard normal numbers of this shape for each sample."""
        return self.shard.local_rows(torch.randn(self.batch_size, *shape, generator=self.generator))

    def flow_times(self, power: float) -> Float[Tensor, " B"]:
        """Draw ``u ** power`` with u uniform in [0, 1)."""
        return self.shard.local_rows(torch.rand(self.batch_size, generator=self.generator) ** power)

    def keep_mask(self, dropout: float) -> Bool[Tensor, " B"]:
        """Draw a mask that is false for that share of the samples."""
        return self.shard.local_rows(
            torch.rand(self.batch_size, generator=self.generator) >= dropout
        )


@cache
def can_compile() -> bool:
    """Check whether `torch.compile` works here; log the reason once if it does not."""
    if not any(shutil.which(name) for name in ("g++", "clang++")):
        log.info("No C++ compiler was found: the training step is not compiled.")
        return False
    try:
        torch.compile(lambda x: (x + 1).relu().sum(), dynamic=False)(torch.ones(8))
    except Exception as error:  # whatever the compiler's tool chain may raise
        log.info(
            "torch.compile does not work here (%s): the training step is not compiled.",
            str(error).splitlines()[0],
        )
        return False
    return True


def compiled(function: Function) -> Function:
    """Compile ``function`` for the shapes of its first call."""
    # Tables of indices are made once and cached; the compiler need not follow the cache.
    warnings.filterwarnings("ignore", message=".*lru_cache.*", category=UserWarning)
    return torch.compile(function, dynamic=False)  # type: ignore[return-value]
