"""The annotated plans of prepared data, as numbers of each frame beside its other arrays."""

import json
from collections import Counter
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Int, UInt8
from torch import Tensor
from tqdm import tqdm

from conventions.rates import FPS
from model.data.prepared import Batch, Clip, PreparedData
from model.data.recordings import DataError, copy_speed
from model.plan.kinds import KindTable
from model.plan.plan import SIDES, GesturePlan, HandPhase, PlanError
from model.plan.textgrid import annotated_plan
from model.plan.tiers import TIERS, Begun, chains_of, frames_of, seen_together
from model.plan.tracks import NUM_TRACKS, tracks_of
from model.speech.transcript import TranscriptError, read_transcript
from model.storage.files import written_atomically

PLANS_FORMAT = 1


@dataclass(frozen=True)
class Events:
    """What a planner learns of a batch's windows, by tier."""

    seen: dict[str, Float[Tensor, "B T _"]]
    """Where its chain is, and that of the tier beside it."""
    event: dict[str, Int[Tensor, "B T"]]
    mark: dict[str, Float[Tensor, "B T _"]]


@dataclass(frozen=True)
class Plans:
    """Plans of all clips, end to end as `PreparedData` has them."""

    data: PreparedData
    tracks: np.ndarray
    """(N, tracks), see `model.plan.tracks`."""
    chains: tuple[dict[str, list[Begun]], ...]
    """Of each clip."""
    kinds: np.ndarray
    """(N, 2) numbers of the gesture that the left and the right hand are in (`KindTable.place`)."""
    table: KindTable

    def of(
        self, batch: Batch, context: int
    ) -> tuple[Float[Tensor, "B heard tracks"], Int[Tensor, "B heard 2"]]:
        """Plans of a batch's windows and ``context`` frames on either side, held past a clip's end.

        Raises:
            ValueError: if windows are mirrored.
        """
        if batch.mirrored.any():
            raise ValueError("Plans know no mirror; train with mirror=0.")
        frames = batch.frames
        rows = frames[:, :1] + np.arange(-context, frames.shape[1] + context)
        which = np.searchsorted(self._starts, frames[:, 0], side="right") - 1
        first, stop = self._starts[which], self._stops[which]
        rows = rows.clip(first[:, None], stop[:, None] - 1)
        return (
            torch.from_numpy(self.tracks[rows].astype(np.float32)),
            torch.from_numpy(self.kinds[rows].astype(np.int64)),
        )

    def events(self, batch: Batch) -> Events:
        """What begins in a batch's windows."""
        which = np.searchsorted(self._starts, batch.frames[:, 0], side="right") - 1
        seen: dict[str, list[np.ndarray]] = {tier.name: [] for tier in TIERS}
        event: dict[str, list[np.ndarray]] = {tier.name: [] for tier in TIERS}
        mark: dict[str, list[np.ndarray]] = {tier.name: [] for tier in TIERS}
        for clip, rows in zip(which, batch.frames, strict=True):
            frames = rows - self._starts[clip]
            found = {tier.name: frames_of(tier, self.chains[clip][tier.name], frames)
                     for tier in TIERS}  # fmt: skip
            for name, numbers in seen_together(found).items():
                seen[name].append(numbers)
                event[name].append(found[name].event)
                mark[name].append(found[name].mark)
        return Events(
            *(
                {name: torch.from_numpy(np.stack(rows)) for name, rows in by_tier.items()}
                for by_tier in (seen, event, mark)
            )
        )

    @cached_property
    def _starts(self) -> np.ndarray:
        return np.array([clip.start for clip in self.data.clips])

    @cached_property
    def _stops(self) -> np.ndarray:
        return np.array([clip.stop for clip in self.data.clips])


def prepare_plans(data: PreparedData, num_speakers: int) -> Plans:
    """Read the annotation beside the recordings once, then map the arrays.

    Raises:
        DataError: if a clip has no annotated plan: only the corpus writes them.
    """
    paths = [data.folder / f"{name}.raw" for name in ("plan-tracks", "plan-kinds")]
    index = data.folder / "plans.json"
    origin = {"format": PLANS_FORMAT, "tracks": NUM_TRACKS}
    plans = [_annotated(data, clip) for clip in data.clips]
    learned = [
        (plan, clip) for clip, plan in zip(data.clips, plans, strict=True)
        if clip.copy == 0 and clip.split == "train"
    ]  # fmt: skip
    said = Counter(word for _, clip in learned for word in _said(textgrid_of(data, clip)))
    table = KindTable.fit(((plan, clip.speaker) for plan, clip in learned), num_speakers, said)
    if not index.is_file() or json.loads(index.read_text()) != origin:
        with (
            written_atomically(paths[0]) as tracks_path,
            written_atomically(paths[1]) as kinds_path,
            tracks_path.open("wb") as tracks_file,
            kinds_path.open("wb") as kinds_file,
        ):
            for clip, plan in tqdm(zip(data.clips, plans, strict=True), desc="plans",
                                   total=len(plans)):  # fmt: skip
                tracks_file.write(tracks_of(plan, clip.num_frames).tobytes())
                kinds_file.write(kinds_of(plan, clip.num_frames, table).tobytes())
        with written_atomically(index) as path:
            path.write_text(json.dumps(origin))
    tracks = np.memmap(paths[0], np.float32, "r", shape=(len(data.poses), NUM_TRACKS))
    kinds = np.memmap(paths[1], np.uint8, "r", shape=(len(data.poses), 2))
    return Plans(data, tracks, tuple(map(chains_of, plans)), kinds, table)


def kinds_of(plan: GesturePlan, num_frames: int, table: KindTable) -> UInt8[np.ndarray, "T 2"]:
    """The number of the gesture that each hand is in, frame by frame."""
    kinds = np.zeros((num_frames, 2), np.uint8)
    for column, side in enumerate(SIDES):
        for phase in plan.hand(side):
            kinds[_frames(phase, num_frames), column] = table.place(phase.kind)
    return kinds


def _frames(phase: HandPhase, num_frames: int) -> slice:
    """Frames whose middle lies in it."""
    first, stop = (max(0, int(np.ceil(at * FPS - 0.5))) for at in (phase.start_s, phase.end_s))
    return slice(min(first, num_frames), min(stop, num_frames))


def textgrid_of(data: PreparedData, clip: Clip) -> Path:
    """Where the annotation of a clip lies."""
    return data.source / "textgrid" / f"{clip.name}.TextGrid"


def _said(path: Path) -> list[str]:
    """The words of an annotation; none where it tells of plans alone."""
    try:
        return [word.text.lower() for word in read_transcript(path).words]
    except TranscriptError:
        return []


def _annotated(data: PreparedData, clip: Clip) -> GesturePlan:
    try:
        plan = annotated_plan(textgrid_of(data, clip))
    except (PlanError, OSError) as error:
        raise DataError(f"{clip.name} has no annotated plan: {error}") from error
    return plan.at_speed(copy_speed(clip.name, clip.copy))
