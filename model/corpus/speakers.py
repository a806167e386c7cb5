"""The speakers: a voice and a gesture style each, with numbers that a BEAT2 speaker table holds."""

from dataclasses import dataclass
from typing import Literal

from model.corpus.rig import SIDES
from model.corpus.voice import Voice


@dataclass(frozen=True)
class Speaker:
    """A voice and a style; plain numbers are factors around 1 unless a unit is in the name."""

    number: int
    name: str
    voice: Voice
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
    two_hands: float = 0.55
    """Probability of two hands where the gesture leaves it free."""
    tempo: float = 1.0
    rest: Literal["hang", "home", "clasp"] = "hang"
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
    beat_shape: str = "relaxed"
    favourites: tuple[str, ...] = ()
    """Gestures drawn three times as often where no word asks for one."""
    held_out: bool = False
    """All clips go to the test split."""

    @property
    def other_hand(self) -> str:
        return SIDES[1] if self.dominant == SIDES[0] else SIDES[0]


SPEAKERS: tuple[Speaker, ...] = (
    Speaker(
        1,
        "anna",
        Voice("slt", 178.0, 28.0),
        two_hands=0.6,
        rest="home",
        smile=0.25,
        beat_shape="soft_pinch",
        favourites=("offer", "present"),
    ),
    Speaker(
        2,
        "ben",
        Voice("rms", 108.0, 20.0),
        amplitude=1.12,
        rate=1.2,
        tempo=1.05,
        energy=1.3,
        sway=1.2,
        steps=1.6,
        two_hands=0.8,
        patience_s=0.9,
        beat_shape="pinch",
        outward_m=0.01,
        favourites=("beat", "frame"),
    ),
    Speaker(
        3,
        "carol",
        Voice("slt", 196.0, 34.0, 1.06, 0.92),
        amplitude=0.75,
        height_m=0.06,
        two_hands=0.2,
        rate=0.95,
        tempo=1.15,
        sway=0.8,
        rest="clasp",
        dominance=0.9,
        beat_shape="flat",
        finger_curl=0.7,
        favourites=("point_up", "precise"),
    ),
    Speaker(
        4,
        "dev",
        Voice("rms", 96.0, 14.0, 0.95, 1.1),
        amplitude=0.8,
        rate=0.7,
        pause=1.5,
        patience_s=0.45,
        energy=0.6,
        steps=0.4,
        height_m=-0.03,
        two_hands=0.35,
        sway=0.8,
        lean_deg=-2.0,
        favourites=("offer_low", "turn_out"),
    ),
    Speaker(
        5,
        "ewan",
        Voice("awb", 132.0, 26.0),
        amplitude=1.25,
        rate=1.25,
        two_hands=0.85,
        outward_m=0.05,
        energy=1.35,
        sway=1.35,
        steps=1.7,
        beat_shape="cage",
        patience_s=1.0,
        finger_life=1.2,
        favourites=("big", "roll", "frame"),
    ),
    Speaker(
        6,
        "fay",
        Voice("slt", 164.0, 24.0, 0.96, 1.07),
        dominant="left",
        dominance=0.9,
        amplitude=0.95,
        two_hands=0.3,
        height_m=0.02,
        smile=0.32,
        beat_shape="cup",
        finger_life=1.25,
        favourites=("offer", "turn_out"),
    ),
    Speaker(
        7,
        "gus",
        Voice("rms", 120.0, 26.0, 1.06, 0.9),
        dominant="left",
        dominance=0.8,
        tempo=1.25,
        rate=1.15,
        amplitude=1.0,
        patience_s=1.2,
        rest="home",
        beat_shape="fist",
        finger_curl=1.35,
        lean_deg=3.0,
        energy=1.2,
        favourites=("chop", "beat"),
    ),
    Speaker(
        8,
        "hana",
        Voice("slt", 215.0, 26.0, 1.12, 1.0),
        amplitude=0.6,
        rate=0.7,
        two_hands=0.55,
        height_m=-0.05,
        outward_m=-0.04,
        rest="clasp",
        energy=0.65,
        sway=0.6,
        steps=0.3,
        patience_s=0.5,
        beat_shape="soft_pinch",
        favourites=("precise", "small_both"),
    ),
    Speaker(
        9,
        "ivan",
        Voice("kal16", 98.0, 18.0),
        amplitude=1.05,
        rate=0.95,
        two_hands=0.15,
        dominance=0.95,
        height_m=0.05,
        tempo=0.9,
        energy=0.9,
        beat_shape="point",
        sway=0.9,
        steps=0.8,
        favourites=("point_up", "chop"),
    ),
    Speaker(
        10,
        "june",
        Voice("awb", 188.0, 36.0, 1.14, 0.93),
        amplitude=1.05,
        rate=1.15,
        tempo=1.15,
        two_hands=0.65,
        height_m=0.07,
        outward_m=-0.02,
        smile=0.35,
        energy=1.25,
        rest="home",
        beat_shape="open",
        finger_curl=0.6,
        finger_life=1.3,
        favourites=("wave_off", "roll"),
    ),
    Speaker(
        11,
        "kofi",
        Voice("rms", 88.0, 22.0, 0.91, 1.0),
        amplitude=1.3,
        rate=0.9,
        tempo=0.82,
        two_hands=0.9,
        height_m=-0.01,
        outward_m=0.06,
        energy=1.0,
        sway=1.4,
        steps=1.2,
        patience_s=0.8,
        beat_shape="open",
        favourites=("present", "sweep", "big"),
    ),
    Speaker(
        12,
        "lena",
        Voice("slt", 150.0, 18.0, 0.92, 1.12),
        amplitude=0.7,
        rate=0.8,
        pause=1.4,
        dominant="left",
        dominance=0.7,
        two_hands=0.75,
        height_m=-0.04,
        rest="clasp",
        energy=0.75,
        sway=0.7,
        steps=0.5,
        patience_s=0.6,
        tempo=0.9,
        beat_shape="flat",
        favourites=("small_both", "weigh", "cup_both"),
    ),
    Speaker(
        13,
        "milo",
        Voice("kal", 128.0, 24.0, 1.05, 0.96),
        amplitude=0.9,
        rate=1.25,
        tempo=1.3,
        two_hands=0.45,
        dominance=0.6,
        outward_m=0.03,
        energy=1.15,
        sway=1.1,
        steps=1.4,
        patience_s=0.9,
        beat_shape="loose",
        finger_life=1.1,
        favourites=("beat", "wave_off"),
    ),
    Speaker(
        14,
        "nora",
        Voice("awb", 170.0, 22.0, 1.09, 1.05),
        amplitude=1.0,
        rate=1.0,
        two_hands=0.5,
        dominant="left",
        dominance=0.6,
        height_m=0.03,
        rest="home",
        smile=0.2,
        lean_deg=2.0,
        beat_shape="cage",
        favourites=("cup_both", "turn_out", "think"),
    ),
    Speaker(
        15,
        "otto",
        Voice("awb", 116.0, 20.0, 0.95, 1.03),
        amplitude=1.1,
        rate=1.05,
        two_hands=0.6,
        energy=1.1,
        height_m=0.02,
        beat_shape="pinch",
        held_out=True,
    ),
    Speaker(
        16,
        "pia",
        Voice("slt", 204.0, 30.0, 1.02, 0.97),
        amplitude=0.9,
        rate=0.95,
        two_hands=0.45,
        rest="home",
        height_m=0.01,
        smile=0.28,
        beat_shape="cup",
        held_out=True,
    ),
)
