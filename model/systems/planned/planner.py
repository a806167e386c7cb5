"""The planner: draws a plan from speech and speaker, frame by frame."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from model.motion.packing import Normaliser
from model.plan.called import with_called_strokes
from model.plan.kinds import KindTable, Spoken, drawn_by
from model.plan.plan import GesturePlan
from model.plan.tiers import BY_NAME, TIERS, Begun, plan_of, seen_of
from model.storage.cards import CheckpointError
from model.storage.checkpoint import load_into, load_weights
from model.storage.settings import from_dict
from model.systems.planned.config import PLANNER, PlannerConfig
from model.systems.planned.planner_network import PlannerNetwork, TierHead

_KINDS = len(TIERS)
"""Sets the draw of kinds apart from those of tiers."""
HOLD_BACK = 1.0
"""By how much, in log odds, an event is less likely for each one that guidance has brought beyond
what the planner expects unguided: guidance shall decide when things happen, not how often."""
_CALLED = _KINDS + 1
"""And that of strokes on words."""


@dataclass(frozen=True)
class Planner:
    """A trained planner, and which gesture a stroke is."""

    network: PlannerNetwork
    normaliser: Normaliser
    """Of speech features."""
    first_goals: Float[Tensor, "speakers 2 3"]
    """Where hands begin, in the tiers' units."""
    kinds: KindTable
    sha256: str

    @property
    def config(self) -> PlannerConfig:
        return self.network.config

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
        drawers = self._drawers(features, speaker, noise_key, guidance)
        for frame in range(1, num_frames):
            for drawer in drawers.values():
                drawer.draw(frame, drawers)
        chains = {name: drawer.chain for name, drawer in drawers.items()}
        rng = np.random.default_rng([*noise_key, _KINDS])
        plan = self.kinds.drawn(plan_of(chains, num_frames), speaker, words, rng)
        chances = np.random.default_rng([*noise_key, _CALLED])
        return with_called_strokes(plan, words, self.kinds, chances)

    def _drawers(
        self,
        features: Float[Tensor, "T speech_dim"],
        speaker: int,
        noise_key: Sequence[int],
        guidance: float,
    ) -> "dict[str, _Drawer]":
        copies = 1 if guidance == 1 else 2
        context = self.config.context
        rows = torch.arange(-context, len(features) + context).clamp(0, len(features) - 1)
        heard = self.network.hear(
            self.normaliser.normalise(features[rows]).expand(copies, -1, -1),
            torch.tensor([speaker, 0])[:copies],
            torch.tensor([True, False])[:copies],
        )
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
            drawers[tier.name] = _Drawer(head, head.heard(heard), guidance, begun, rng)
        return drawers


class _Drawer:
    """Draws one tier's chain. Its chances are drawn for every frame, used or not, so that plans of
    other speech under one key share them."""

    def __init__(
        self,
        head: TierHead,
        heard: Float[Tensor, "copies T hidden"],
        guidance: float,
        begun: Begun,
        rng: np.random.Generator,
    ) -> None:
        num_frames, units = heard.shape[1], len(head.tier.units)
        self.chain = [begun]
        self._head, self._heard, self._guidance = head, heard, guidance
        self._seen = head.seen.weight
        self._excess = 0.0
        """Events that were to be expected so far, less those without guidance."""
        chance, which, normal = rng.spawn(3)  # so that longer speech draws the same at first
        self._chance = chance.random(num_frames)
        self._which = which.random(num_frames)
        self._normal = normal.standard_normal((num_frames, units))

    def draw(self, frame: int, others: "dict[str, _Drawer]") -> None:
        """Stay, or begin something at this frame."""
        head = self._head
        told = [seen_of(head.tier, self.chain[-1], frame)]
        if head.tier.beside:
            other = others[head.tier.beside].chain[-1]
            told.append(seen_of(BY_NAME[head.tier.beside], other, frame))
        seen = torch.from_numpy(np.concatenate(told)) @ self._seen.T
        state = torch.nn.functional.silu(self._heard[:, frame] + seen)
        logs = head.events(state)
        log = logs[-1] + self._guidance * (logs[0] - logs[-1])
        log[1:] -= HOLD_BACK * self._excess
        shares = torch.softmax(log, dim=0).numpy()
        self._excess += float(shares[1:].sum() - logs[0, 1:].exp().sum())
        event = drawn_by(shares, self._chance[frame])
        if event == 0:
            return
        mark: Any = ()
        if head.tier.units:
            marks = head.marks(state[:1], torch.tensor([event - 1]))
            k = drawn_by(torch.softmax(marks.logits[0], 0).numpy(), self._which[frame])
            mean, spread = marks.mean[0, k].numpy(), marks.spread[0, k].numpy()
            mark = tuple((mean + spread * self._normal[frame]).tolist())
        self.chain.append(Begun(frame, event - 1, mark))


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
    return Planner(network, Normaliser.of_tensors(tensors), goals, kinds, card["sha256"])
