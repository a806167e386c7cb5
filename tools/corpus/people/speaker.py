"""Who speaks: a voice and a gesture style each, as ``speakers.toml`` beside this tells them."""

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from model.storage.cards import from_dict
from tools.corpus.people.rig import SIDES
from tools.corpus.people.voice import FliteVoice


@dataclass(frozen=True)
class Speaker:
    """A voice and a style; plain numbers are factors around 1 unless a unit is in the name."""

    number: int
    name: str
    voice: FliteVoice
    pause: float = 1.0
    """Length and share of pauses between sentences."""
    dominant: Literal["left", "right"] = "right"
    dominance: float = 0.7
    """Probability that a one-hand gesture uses the dominant hand."""
    amplitude: float = 1.0
    rate: float = 1.0
    """Share of accents that get a stroke."""
    height_m: float = 0.0
    """Raises the gesture space."""
    outward_m: float = 0.0
    """Widens the gesture space."""
    forward_m: float = 0.0
    """Moves the gesture space away from the body."""
    elbow_out: float = 0.0
    """Lifts the elbows sideways in gestures; below 0 they are tucked in."""
    palm_up: float = 0.0
    """Turns palms upwards, as a share of a unit vector; below 0 downwards."""
    wrist_deg: float = 0.0
    """Habitual bend of the wrist towards the palm."""
    two_hands: float = 0.55
    """Probability of two hands where the gesture leaves it free."""
    tempo: float = 1.0
    rest: str = "hang"
    other_rest: str = ""
    """Where the other hand rests, and waits while it takes no part; empty: as the dominant one."""
    listening_rest: str = ""
    """Where hands lie while the other one speaks; empty: as in pauses."""
    ready: str = "low"
    """Where a hand waits between gestures."""
    patience_s: float = 0.7
    """Pauses longer than this send the hands down."""
    energy: float = 1.0
    """Accents of head and trunk."""
    sway: float = 1.0
    lean_deg: float = 0.0
    steps: float = 1.0
    smile: float = 0.15
    finger_curl: float = 1.0
    finger_life: float = 1.0
    beats: float = 1.0
    """Share of accents after a stroke that get a beat."""
    literal: float = 1.0
    """Share of words that call for a gesture and get it."""
    beat_shape: str = "relaxed"
    idle_shape: str = "relaxed"
    favourites: tuple[str, ...] = ()
    """Gestures drawn four times as often where no word asks for one."""
    held_out: bool = False
    """All clips go to the test split."""

    @property
    def other_hand(self) -> str:
        return SIDES[1] if self.dominant == SIDES[0] else SIDES[0]

    def listening_rest_of(self, side: str) -> str:
        """The rest pose of a hand that has nothing to say."""
        return self.listening_rest or self.rest_of(side)

    def rest_of(self, side: str) -> str:
        """The rest pose of a hand in a pause."""
        return self.other_rest or self.rest if side == self.other_hand else self.rest

    def waiting_of(self, side: str, chance: float) -> str:
        """The rest pose of a hand that takes no part, for a draw between 0 and 1."""
        if side == self.other_hand and self.other_rest:
            return self.other_rest
        return self.ready if chance < 0.7 else self.rest


_FILE = Path(__file__).with_name("speakers.toml")

SPEAKERS: tuple[Speaker, ...] = tuple(
    from_dict(Speaker, told) for told in tomllib.loads(_FILE.read_text("utf-8"))["speakers"]
)
