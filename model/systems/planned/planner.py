"""The planner: draws a plan from speech and speaker, frame by frame."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Float32
from torch import Tensor

from model.motion.packing import Normaliser
from model.networks.speech_codes import SpeechCodes, load_codes
from model.plan.called import with_called_strokes
from model.plan.kinds import KindTable, Spoken, drawn_by
from model.plan.plan import GesturePlan
from model.plan.tiers import BY_NAME, TIERS, Begun, plan_of, seen_of
from model.speech.codes import SPEECH_ENCODER
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
            heard_by_planner(features[rows], self.normaliser, self.codes).expand(copies, -1, -1),
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


def heard_by_planner(
    features: Float[Tensor, "*B T speech_dim"], normaliser: Normaliser, codes: SpeechCodes | None
) -> Float[Tensor, "*B T heard_dim"]:
    """Normalised features, and the codes of an encoder beside them."""
    heard = normaliser.normalise(features)
    return heard if codes is None else torch.cat([heard, codes.of(features)], dim=-1)


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
        self._head, self._guidance = head, guidance
        self._heard = heard.numpy()
        self._events = _Events(head)
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
        state, logs = self._events(self._heard[:, frame], np.concatenate(told))
        log = logs[-1] + self._guidance * (logs[0] - logs[-1])
        log[1:] -= HOLD_BACK * self._excess
        shares = np.exp(log - log.max())
        shares /= shares.sum()
        self._excess += float(shares[1:].sum() - np.exp(logs[0, 1:]).sum())
        event = drawn_by(shares, self._chance[frame])
        if event == 0:
            return
        mark: Any = ()
        if head.tier.units:
            marks = head.marks(torch.from_numpy(state[:1]), torch.tensor([event - 1]))
            k = drawn_by(torch.softmax(marks.logits[0], 0).numpy(), self._which[frame])
            mean, spread = marks.mean[0, k].numpy(), marks.spread[0, k].numpy()
            mark = tuple((mean + spread * self._normal[frame]).tolist())
        self.chain.append(Begun(frame, event - 1, mark))


class _Events:
    """`TierHead.state` and `TierHead.events` of one frame in numpy: it is asked for every frame
    and tier, and calling torch takes five times as long as the arithmetic."""

    def __init__(self, head: TierHead) -> None:
        first, last = head.event[0], head.event_out
        assert isinstance(first, torch.nn.Linear)
        self._seen = head.seen.weight.numpy().T
        self._layers = [(layer.weight.numpy().T, layer.bias.numpy()) for layer in (first, last)]

    def __call__(
        self, heard: Float32[np.ndarray, "copies hidden"], seen: Float32[np.ndarray, " seen"]
    ) -> tuple[Float32[np.ndarray, "copies hidden"], Float32[np.ndarray, "copies events"]]:
        state = _silu(heard + seen @ self._seen)
        (weight, bias), (out, out_bias) = self._layers
        logits = _silu(state @ weight + bias) @ out + out_bias
        above = logits - logits.max(-1, keepdims=True)
        return state, above - np.log(np.exp(above).sum(-1, keepdims=True))


def _silu(x: Float32[np.ndarray, "*shape"]) -> Float32[np.ndarray, "*shape"]:
    return x / (1 + np.exp(-x))


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
