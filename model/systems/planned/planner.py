"""The planner: draws a plan from speech and speaker, frame by frame."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from model.motion.packing import Normaliser
from model.networks.speech_codes import SpeechCodes, load_codes
from model.plan.called import with_called_strokes
from model.plan.kinds import KindTable, Spoken
from model.plan.plan import GesturePlan
from model.plan.tiers import TIERS, Begun, plan_of
from model.speech.codes import SPEECH_ENCODER
from model.storage.cards import CheckpointError
from model.storage.checkpoint import load_into, load_weights
from model.storage.settings import from_dict
from model.systems.planned.config import PLANNER, PlannerConfig
from model.systems.planned.drawer import Drawer
from model.systems.planned.planner_network import PlannerNetwork, TierHead

KINDS = len(TIERS)
"""Sets the draw of kinds apart from those of tiers."""
_CALLED = KINDS + 1
"""And that of strokes on words."""


@dataclass(frozen=True)
class Planner:
    """A trained planner, what it hears with, and which gesture a stroke is."""

    network: PlannerNetwork
    normaliser: Normaliser
    """Of speech features."""
    codes: SpeechCodes | None
    """What it hears beside the features."""
    first_goals: Float[Tensor, "speakers 2 3"]
    """Where hands begin, in the tiers' units."""
    kinds: KindTable
    sha256: str

    @property
    def config(self) -> PlannerConfig:
        return self.network.config

    @property
    def sha256s(self) -> dict[str, str]:
        """Of its weights and of those that it hears with."""
        heard_with = {} if self.codes is None else {SPEECH_ENCODER: self.codes.sha256}
        return {PLANNER: self.sha256, **heard_with}

    @torch.inference_mode()
    def plan(
        self,
        features: Float[Tensor, "T speech_dim"],
        speaker: int,
        words: Sequence[Spoken],
        noise_key: Sequence[int],
        guidance: float,
    ) -> GesturePlan:
        """A plan for the whole of some speech.

        Args:
            words: what is said, where that is known.
            noise_key: decides the draw; equal keys give plans that share their noise.
            guidance: how many times what speech and speaker change is taken; 1 as trained.
        """
        num_frames = len(features)
        drawers = self.drawers(features, speaker, noise_key, guidance)
        for frame in range(1, num_frames):
            for drawer in drawers.values():
                drawer.draw(frame, drawers)
        chains = {name: drawer.chain for name, drawer in drawers.items()}
        rng = np.random.default_rng([*noise_key, KINDS])
        plan = self.kinds.drawn(plan_of(chains, num_frames), speaker, words, rng)
        chances = np.random.default_rng([*noise_key, _CALLED])
        return with_called_strokes(plan, words, self.kinds, chances)

    def drawers(
        self,
        features: Float[Tensor, "T speech_dim"],
        speaker: int,
        noise_key: Sequence[int],
        guidance: float,
    ) -> dict[str, Drawer]:
        """What draws the tiers of some speech, each where plans begin."""
        context = self.config.context
        rows = torch.arange(-context, len(features) + context).clamp(0, len(features) - 1)
        heard = self.hear(features[rows], speaker, guidance)
        goals = self.first_goals[speaker].tolist()
        begins = {
            "left": Begun(0, 0, tuple(goals[0])), "right": Begun(0, 0, tuple(goals[1])),
            "look": Begun(0, 0, (0.0, 0.0)), "nod": Begun(0, 0, (0.0,)),
            "brow": Begun(0, 0, (0.0,)), "smile": Begun(0, 0, (0.0,)),
            **{f"{side} foot": Begun(0, 1) for side in ("left", "right")},
        }  # fmt: skip
        drawers = {}
        for number, tier in enumerate(TIERS):
            head = self.network.heads[tier.name]
            assert isinstance(head, TierHead)
            rng = np.random.default_rng([*noise_key, number])
            begun = begins.get(tier.name, Begun(0, 0))
            drawers[tier.name] = Drawer(head, heard[tier.name], guidance, begun, rng)
        return drawers

    def hear(
        self, features: Float[Tensor, "T_and_context speech_dim"], speaker: int, guidance: float
    ) -> dict[str, Float[np.ndarray, "copies T hidden"]]:
        """What each tier hears of frames, given those and the context around them; the second copy,
        which hears nothing, is there where guidance needs it."""
        copies = 1 if guidance == 1 else 2
        heard = self.network.hear(
            heard_by_planner(features, self.normaliser, self.codes).expand(copies, -1, -1),
            torch.tensor([speaker, 0])[:copies],
            torch.tensor([True, False])[:copies],
        )
        found = {}
        for tier in TIERS:
            head = self.network.heads[tier.name]
            assert isinstance(head, TierHead)
            found[tier.name] = head.heard(heard).numpy()
        return found


def heard_by_planner(
    features: Float[Tensor, "*B T speech_dim"], normaliser: Normaliser, codes: SpeechCodes | None
) -> Float[Tensor, "*B T heard_dim"]:
    """Normalised features, and the codes of an encoder beside them."""
    heard = normaliser.normalise(features)
    return heard if codes is None else torch.cat([heard, codes.of(features)], dim=-1)


def load_planner(folder: Path) -> Planner:
    """Read the planner.

    Raises:
        CheckpointError: if its files are missing or damaged.
    """
    tensors, card = load_weights(folder, PLANNER)
    try:
        config = from_dict(PlannerConfig, card["config"]["planner"])
        kinds = KindTable.of_tensors(tensors)
        goals = tensors["begins.goals"]
    except (KeyError, TypeError, AttributeError) as error:
        raise CheckpointError(f"The card of {PLANNER} lacks or misstates {error}.") from None
    network = PlannerNetwork(config)
    load_into(network, tensors, "network.", PLANNER)
    network.eval().requires_grad_(False)
    codes = load_codes(folder) if config.codes else None
    return Planner(network, Normaliser.of_tensors(tensors), codes, goals, kinds, card["sha256"])
