"""Where the numbers of sets come from, so that others can be held against them."""

from __future__ import annotations

import datetime
import hashlib
import json
from pathlib import Path
from typing import Any

from conventions.names import REFERENCE_NAME
from model.storage.cards import BUNDLED_WEIGHTS, load_card


def file_sha256(path: Path) -> str:
    """Of a file of any size."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def origin_of(
    systems: list[str],
    clips: list[str],
    numbers: list[dict[str, Any]],
    measures: int,
    mean_speeds: Path | None,
) -> dict[str, Any]:
    """What stands in ``many.json`` as ``provenance``.

    Args:
        numbers: of each clip, in ``systems`` by name the ``sha256`` of its file.
        measures: number of the form in which clips are measured.
        mean_speeds: published ones that BeatAlign was measured with.
    """
    from model.systems.autoencoders.config import FGD_ENCODER
    from model.training.run_folder import revision

    digests = {
        name: _digest(
            [clip, each["systems"][name]["sha256"]]
            for clip, each in zip(clips, numbers, strict=True)
        )
        for name in systems
    }
    return {
        "made_at": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "project": revision(),
        "systems": digests,
        "reference": digests.get(REFERENCE_NAME),
        "encoders": {"FGD": load_card(BUNDLED_WEIGHTS, FGD_ENCODER)["sha256"]},
        "mean_speeds": mean_speeds and file_sha256(mean_speeds),
        "measures": measures,
    }


def _digest(parts: Any) -> str:
    return hashlib.sha256(json.dumps(list(parts)).encode()).hexdigest()
