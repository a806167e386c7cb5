"""The card of trained weights: what was trained, on what, how long, how well."""

import datetime
import json
import subprocess
from pathlib import Path
from typing import Any

from conventions.rates import FPS
from model.data.prepared import PreparedData
from model.storage.cards import load_card
from model.storage.settings import to_json
from model.training.config import TrainConfig
from model.training.task import Start


def make_card(
    config: TrainConfig, data: PreparedData, folder: Path, steps: int, validation: dict,
    origin: dict[str, Any] | None,
) -> dict[str, Any]:  # fmt: skip
    corpus = folder / "corpus.json"
    train_clips = data.of_split("train")
    seen = {clip.speaker for clip in train_clips}
    train_frames = sum(clip.num_frames for clip in train_clips if clip.copy == 0)
    return {
        "config": json.loads(to_json(config)),
        "speakers": {name: n for n, name in sorted(data.speakers.items()) if n in seen},
        "training_data": json.loads(corpus.read_text()) if corpus.is_file() else folder.name,
        "training_hours": round(train_frames / FPS / 3600, 3),
        "steps": steps,
        "started_from_bundled_weights": origin is not None,
        "started_from": origin,
        "validation": {name: round(value, 6) for name, value in validation.items()},
        "date": datetime.date.today().isoformat(),
        "revision": revision(),
    }


def origin_of(start: Start) -> dict[str, Any]:
    """Which weights a training begins with, for its card."""
    card = load_card(start.folder, start.system)
    return {"system": start.system, "sha256": card["sha256"], "steps": card.get("steps")}


def revision() -> str:
    """Git revision of the code, with ``+`` for uncommitted changes; "unknown" without git.

    Files that Git does not know do not count: results may lie beside the code.
    """
    root = Path(__file__).parent

    def git(*command: str) -> str:
        return subprocess.run(
            ["git", "-C", str(root), *command], capture_output=True, text=True, check=True
        ).stdout.strip()

    try:
        changed = git("status", "--porcelain", "--untracked-files=no")
        return git("rev-parse", "--short", "HEAD") + ("+" if changed else "")
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
