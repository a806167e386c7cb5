"""Planner: draws a plan from speech and speaker, tier by tier and frame by frame.

A drawer may look ahead and go back: the draw for frames without speech yet is repeated when it has
arrived, with the same random numbers.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Float32
from torch import Tensor

from model.generation.base import WindowSpec
from model.motion.packing import Normaliser
from model.networks.speech_codes import FrozenSpeechEncoder, load_speech_codes
from model.networks.trained import TrainedWeights
from model.plan import plan_features
from model.plan.kinds import KindTable, kind_numbers, sample_index
from model.plan.plan import GesturePlan
from model.plan.plan_features import TIERS, TIERS_BY_NAME, EventOnset
from model.speech.encoder import SPEECH_ENCODER
from model.systems.planned.config import PLANNER, PlannerConfig
from model.systems.planned.network import PlannerNetwork, TierHead

RATE_CORRECTION = 1.0
"""Reduction in log odds of an event for each one that guidance has added to the number expected as
trained: speech shall decide when things happen, not how often."""


EventBias = Callable[
    [str, int, EventOnset, Mapping[str, EventOnset]], Float[np.ndarray, " events"] | None
]
"""Function of a tier's name, the frame, the tier's state and all states, which returns log odds to
add to its events; None adds nothing."""


class EventChainSampler:
    """Sampler of one tier's event chain, with random numbers for every frame, used or not.

    So plans of other speech with one key share them.
    """

    def __init__(
        self,
        head: TierHead,
        tier_inputs: Float[np.ndarray, "copies T hidden"],
        strength: float,
        begun: EventOnset,
        rng: np.random.Generator,
    ) -> None:
        self.chain = [begun]
        self._head, self._strength = head, strength
        self._tier_inputs, self._first = tier_inputs, 0
        self._events = _Events(head)
        self._excess = 0.0
        """Number of events expected so far, less that expected as trained."""
        self._excess_then = 0.0
        self._forced: EventOnset | None = None
        """Event that begins next, whatever is drawn until then."""
        self._chances = _RandomStream(rng, len(head.tier.mark_scales))

    def set_tier_inputs(
        self, tier_inputs: Float[np.ndarray, "copies T hidden"], first: int
    ) -> None:
        """Set the features of frames from ``first`` on."""
        self._tier_inputs, self._first = tier_inputs, first
        self._chances.forget_before(first)

    def draw(
        self, frame: int, others: "Mapping[str, EventChainSampler]", bias: EventBias | None = None
    ) -> None:
        """Draw whether something begins at this frame, or the state stays."""
        head = self._head
        now = self.chain[-1]
        states = [plan_features.chain_state_at(head.tier, now, frame)]
        if head.tier.coupled_tier:
            other = others[head.tier.coupled_tier].chain[-1]
            states.append(
                plan_features.chain_state_at(TIERS_BY_NAME[head.tier.coupled_tier], other, frame)
            )
        tier_inputs = self._tier_inputs[:, frame - self._first]
        state, logs = self._events(tier_inputs, np.concatenate(states))
        log = logs[-1] + self._strength * (logs[0] - logs[-1])
        log[1:] -= RATE_CORRECTION * self._excess
        shares = _shares(log)
        self._excess += float(shares[1:].sum() - np.exp(logs[0, 1:]).sum())
        chance, which, normal = self._chances.at(frame)
        if self._forced is not None:
            if frame >= self._forced.frame:
                self.chain.append(self._forced)
                self._forced = None
            return
        if bias is not None:
            all_now = {name: each.chain[-1] for name, each in others.items()}
            odds = bias(head.tier.name, frame, now, all_now)
            shares = shares if odds is None else _shares(log + odds)
        event = sample_index(shares, chance)
        if event == 0:
            return
        mark: Any = ()
        if head.tier.mark_scales:
            marks = head.marks(torch.from_numpy(state[:1]), torch.tensor([event - 1]))
            k = sample_index(torch.softmax(marks.logits[0], 0).numpy(), which)
            mean, std = marks.mean[0, k].numpy(), marks.std[0, k].numpy()
            mark = tuple((mean + std * normal).tolist())
        self.chain.append(EventOnset(frame, event - 1, mark))

    def onset_before(self, frame: int) -> EventOnset:
        """Return the state before a frame."""
        return next(begun for begun in reversed(self.chain) if begun.frame < frame)

    def save_position(self) -> None:
        """Save the rate correction at this frame, the only one to which `rewind` can go back."""
        self._excess_then = self._excess

    def rewind(self, frame: int, keeps_next_event: bool) -> None:
        """Go back to the frame of `save_position`, and keep the event drawn next if asked to.

        With ``keeps_next_event`` the present state lasts as drawn.
        """
        chain = [begun for begun in self.chain if begun.frame < frame]
        later = self.chain[len(chain) :]
        self.chain, self._excess = chain, self._excess_then
        self._forced = later[0] if later and keeps_next_event else None

    def forget_before(self, frame: int, num_context_events: int) -> None:
        """Remove events before a frame, but the last ``num_context_events`` of them."""
        old = sum(begun.frame < frame for begun in self.chain)
        del self.chain[: max(0, old - num_context_events)]


class _RandomStream:
    """Random numbers of every frame in turn; a longer stretch starts with the same."""

    def __init__(self, rng: np.random.Generator, units: int) -> None:
        self._streams, self._units = rng.spawn(3), units
        self._frames: dict[int, tuple[float, float, Float[np.ndarray, " units"]]] = {}
        self._drawn = 0

    def at(self, frame: int) -> tuple[float, float, Float[np.ndarray, " units"]]:
        """Return uniform numbers for event and mixture component, and normal ones for the mark."""
        event, which, normal = self._streams
        for number in range(self._drawn, frame + 1):
            numbers = event.random(), which.random(), normal.standard_normal(self._units)
            self._frames[number] = numbers
        self._drawn = max(self._drawn, frame + 1)
        return self._frames[frame]

    def forget_before(self, frame: int) -> None:
        self._frames = {at: numbers for at, numbers in self._frames.items() if at >= frame}


def _shares(log: Float[np.ndarray, " events"]) -> Float[np.ndarray, " events"]:
    shares = np.exp(log - log.max())
    return shares / shares.sum()


class _Events:
    """`TierHead.hidden` and `event_log_probs` of a frame in numpy, 5 times as fast as torch."""

    def __init__(self, head: TierHead) -> None:
        first, last = head.event[0], head.event_out
        assert isinstance(first, torch.nn.Linear)
        self._state_weight = head.seen.weight.numpy().T
        self._layers = [(layer.weight.numpy().T, layer.bias.numpy()) for layer in (first, last)]

    def __call__(
        self,
        tier_inputs: Float32[np.ndarray, "copies hidden"],
        states: Float32[np.ndarray, " state_dim"],
    ) -> tuple[Float32[np.ndarray, "copies hidden"], Float32[np.ndarray, "copies events"]]:
        state = _silu(tier_inputs + states @ self._state_weight)
        (weight, bias), (out, out_bias) = self._layers
        logits = _silu(state @ weight + bias) @ out + out_bias
        above = logits - logits.max(-1, keepdims=True)
        return state, above - np.log(np.exp(above).sum(-1, keepdims=True))


def _silu(x: Float32[np.ndarray, "*shape"]) -> Float32[np.ndarray, "*shape"]:
    return x / (1 + np.exp(-x))


KIND_KEY = len(TIERS)
"""Key that separates the draw of gesture types from those of tiers."""
_CALLED_STROKE_KEY = KIND_KEY + 1
"""Key of the draw of strokes on words."""


@dataclass(frozen=True)
class Planner:
    """Trained planner with its speech input and the table of gesture types."""

    network: PlannerNetwork
    normaliser: Normaliser
    """Statistics of speech features."""
    codes: FrozenSpeechEncoder | None
    """Encoder of codes, an input besides the features; None without one."""
    first_goals: Float[Tensor, "speakers 2 3"]
    """Initial goals of the hands, in the tiers' units."""
    kinds: KindTable
    sha256: str

    @property
    def config(self) -> PlannerConfig:
        return self.network.config

    @property
    def sha256s(self) -> dict[str, str]:
        """Digests of its weights and of its speech encoder's."""
        encoders = {} if self.codes is None else {SPEECH_ENCODER: self.codes.sha256}
        return {PLANNER: self.sha256, **encoders}

    @torch.inference_mode()
    def plan(self, features: Float[Tensor, "T speech_dim"], spec: WindowSpec) -> GesturePlan:
        """Draw a plan for whole speech; equal keys give plans that share their noise."""
        num_frames = len(features)
        drawers = self.make_samplers(features, spec)
        for frame in range(1, num_frames):
            for drawer in drawers.values():
                drawer.draw(frame, drawers)
        chains = {name: drawer.chain for name, drawer in drawers.items()}
        rng = np.random.default_rng([*spec.clip_noise_key, KIND_KEY])
        plan = self.kinds.sample_kinds(
            plan_features.chains_to_plan(chains, num_frames), spec.speaker_index, spec.words, rng
        )
        chances = np.random.default_rng([*spec.clip_noise_key, _CALLED_STROKE_KEY])
        return self.kinds.add_word_strokes(plan, spec.words, chances)

    def make_samplers(
        self, features: Float[Tensor, "T speech_dim"], spec: WindowSpec
    ) -> dict[str, EventChainSampler]:
        """Make the samplers of all tiers for some speech, each in its initial state."""
        context = self.config.context_frames_per_side
        rows = torch.arange(-context, len(features) + context).clamp(0, len(features) - 1)
        tier_inputs = self.tier_inputs(features[rows], spec)
        goals = self.first_goals[spec.speaker_index].tolist()
        begins = {
            "left": EventOnset(0, 0, tuple(goals[0])),
            "right": EventOnset(0, 0, tuple(goals[1])),
            **{f"{side} foot": EventOnset(0, 1) for side in ("left", "right")},
        }
        drawers = {}
        for number, tier in enumerate(TIERS):
            head = self.network.heads[tier.name]
            assert isinstance(head, TierHead)
            rng = np.random.default_rng([*spec.clip_noise_key, number])
            begun = begins.get(tier.name, EventOnset(0, 0, (0.0,) * len(tier.mark_scales)))
            drawers[tier.name] = EventChainSampler(
                head, tier_inputs[tier.name], spec.guidance, begun, rng
            )
        return drawers

    def tier_inputs(
        self, features: Float[Tensor, "T_and_context speech_dim"], spec: WindowSpec
    ) -> dict[str, Float[np.ndarray, "copies T hidden"]]:
        """Compute each tier's input from features with context; a second copy has no speech."""
        copies = 1 if spec.guidance == 1 else 2
        states = self.network.encode_speech_and_speaker(
            planner_inputs(features, self.normaliser, self.codes).expand(copies, -1, -1),
            torch.tensor([spec.speaker_index, 0])[:copies],
            torch.tensor([True, False])[:copies],
        )
        streams = {}
        for tier in TIERS:
            head = self.network.heads[tier.name]
            assert isinstance(head, TierHead)
            streams[tier.name] = head.heard(states).numpy()
        return streams

    def motion_network_inputs(
        self, features: Float[Tensor, "n speech_dim"], plan: GesturePlan, first: int
    ) -> Float[Tensor, "n input_dim"]:
        """Concatenate features with a plan's tracks and gesture types from frame ``first`` on."""
        stop = first + len(features)
        tracks = torch.from_numpy(plan_features.plan_tracks(plan, stop)[first:])
        kinds = torch.from_numpy(kind_numbers(plan, stop, self.kinds)[first:]).float()
        return torch.cat([features, tracks, kinds], dim=1)


def planner_inputs(
    features: Float[Tensor, "*B T speech_dim"],
    normaliser: Normaliser,
    codes: FrozenSpeechEncoder | None,
) -> Float[Tensor, "*B T input_dim"]:
    """Concatenate normalised features and the codes of an encoder."""
    normalised = normaliser.normalise(features)
    return normalised if codes is None else torch.cat([normalised, codes.encode(features)], dim=-1)


def load_planner(folder: Path) -> Planner:
    """Load the planner."""
    trained = TrainedWeights.read(folder, PLANNER)
    config = trained.card.config(PlannerConfig, "planner")
    with trained.card.reporting_errors():
        kinds = KindTable.from_tensors(trained.tensors)
        goals = trained.tensors["begins.goals"]
    network = trained.load_into(PlannerNetwork(config))
    codes = load_speech_codes(folder) if config.codes else None
    return Planner(network, trained.normaliser, codes, goals, kinds, trained.sha256)
