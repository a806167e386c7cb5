"""What a folder of weights offers, read from its JSON cards without importing torch."""

import json
from pathlib import Path
from typing import Any

from conventions.names import file_stem

BUNDLED_WEIGHTS = Path(__file__).parents[1] / "weights"
CALM_AND_LIVELY = "hana", "june"
"""The calmest speaker of the bundled weights, and a lively one."""


class CheckpointError(ValueError):
    """Weights that are missing, damaged or of another shape than their card says."""


def load_card(folder: Path, system: str) -> dict[str, Any]:
    """The JSON card of a system.

    Raises:
        CheckpointError: if it is missing or no JSON object.
    """
    path = folder / f"{file_stem(system)}.json"
    try:
        card = json.loads(path.read_text())
    except FileNotFoundError:
        raise CheckpointError(f"{path} is missing; train {system} or pass --weights.") from None
    except (OSError, ValueError) as error:
        raise CheckpointError(f"{path} cannot be read: {error}") from None
    if not isinstance(card, dict) or "sha256" not in card:
        raise CheckpointError(f"{path} is no weights card: it has no sha256.")
    return card
