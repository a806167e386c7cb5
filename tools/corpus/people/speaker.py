"""Speakers with a voice and a gesture style each, from ``speakers.toml`` in this folder."""

import re
import shutil
import subprocess
import tempfile
import tomllib
import wave
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Float
from scipy.signal import resample_poly

from conventions.rates import SAMPLE_RATE
from model.storage.cards import from_dict
from tools.corpus.people.rig import SIDES

PAUSE = "pau"
VOWELS = frozenset("aa ae ah ao aw ax axr ay eh er ey ih ix iy ow oy uh uw".split())


class VoiceError(RuntimeError):
    """Error of the speech synthesizer: flite is missing or failed."""


@dataclass(frozen=True)
class FliteVoice:
    """Voice of flite with changed pitch, formants and pace."""

    flite_name: str
    f0_hz: float
    f0_sd_hz: float
    formant: float = 1.0  # > 1: a shorter vocal tract
    stretch: float = 1.0  # > 1: slower


@dataclass(frozen=True)
class Phone:
    """Speech sound; ``word`` is its index in the sentence, ``stress`` is 1 if stressed."""

    name: str
    start_s: float
    end_s: float
    word: int = -1
    stress: int = 0

    @property
    def is_vowel(self) -> bool:
        return self.name in VOWELS


def require_flite() -> None:
    """Raise a VoiceError with installation help if flite is missing."""
    if shutil.which("flite") is None or shutil.which("t2p") is None:
        raise VoiceError(
            "The speech program flite was not found; install it with: apt-get install flite"
        )


def words_of(sentence: str) -> list[str]:
    """Return the words of a sentence in lower case."""
    return re.findall(r"[a-z']+", sentence.lower())


def synthesise(
    sentence: str, voice: FliteVoice, stretch: float = 1.0
) -> tuple[Float[np.ndarray, " N"], list[Phone]]:
    """Speak one sentence: samples at 16 kHz, and its phones with word numbers and stress.

    A formant factor is reached by playing faster or slower; duration and pitch are corrected
    beforehand, so that only the formants change.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "speech.wav"
        features = {
            "duration_stretch": voice.stretch * stretch * voice.formant,
            "int_f0_target_mean": voice.f0_hz / voice.formant,
            "int_f0_target_stddev": voice.f0_sd_hz / voice.formant,
        }
        settings = [
            part for key, value in features.items() for part in ("--setf", f"{key}={value:.4f}")
        ]
        command = ["flite", "-voice", voice.flite_name, *settings, "-psdur", "-t", sentence]
        listing = _run([*command, "-o", str(path)])
        samples, rate = _read_wav(path)
    # Playing `rate` samples in a second at `formant` times the speed.
    denominator = round(rate * voice.formant / 10.0) * 10
    waveform = resample_poly(samples, SAMPLE_RATE // 10, denominator // 10)
    speed = denominator / rate
    phones = []
    start = 0.0
    for token in listing.split():
        name, end = token.rsplit(":", 1)
        phones.append(Phone(name, start / speed, float(end) / speed))
        start = float(end)
    if not any(phone.name != PAUSE for phone in phones):
        raise VoiceError(f"flite found no words to speak in the sentence {sentence!r}.")
    return waveform, align(words_of(sentence), phones)


@lru_cache(maxsize=4096)
def pronounce(word: str) -> tuple[tuple[str, int], ...]:
    """Return the phones of a word alone, each with 1 if it carries the main stress."""
    phones = [p for p in _run(["t2p", word]).split() if p != PAUSE]
    return tuple((p.rstrip("012"), int(p.endswith("1"))) for p in phones)


def align(words: list[str], phones: list[Phone]) -> list[Phone]:
    """Assign words and stress to phones by least edit distance, as flite reduces some sounds."""
    expected = [(p, s, w) for w, word in enumerate(words) for p, s in pronounce(word)]
    spoken = [k for k, phone in enumerate(phones) if phone.name != PAUSE]
    rows, columns = len(expected), len(spoken)
    cost = np.zeros((rows + 1, columns + 1))
    cost[:, 0], cost[0] = np.arange(rows + 1), np.arange(columns + 1)
    for i in range(1, rows + 1):
        for j in range(1, columns + 1):
            swap = _substitution(expected[i - 1][0], phones[spoken[j - 1]].name)
            cost[i, j] = min(cost[i - 1, j - 1] + swap, cost[i - 1, j] + 1.0, cost[i, j - 1] + 1.0)
    result = list(phones)
    i, j = rows, columns
    while j > 0:
        phone = phones[spoken[j - 1]]
        swap = _substitution(expected[i - 1][0], phone.name) if i > 0 else 0.0
        if i > 0 and cost[i, j] == cost[i - 1, j - 1] + swap:
            _, stress, word = expected[i - 1]
            result[spoken[j - 1]] = replace(phone, word=word, stress=stress)
            i, j = i - 1, j - 1
        elif i > 0 and cost[i, j] == cost[i - 1, j] + 1.0:
            i -= 1
        else:
            word = expected[min(i, rows - 1)][2]
            result[spoken[j - 1]] = replace(phone, word=word)
            j -= 1
    return result


def _substitution(a: str, b: str) -> float:
    if a == b:
        return 0.0
    return 0.4 if (a in VOWELS) == (b in VOWELS) else 1.6


def _run(command: list[str]) -> str:
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        require_flite()
        raise
    if done.returncode != 0:
        reason = done.stderr.strip() or f"exit status {done.returncode}"
        raise VoiceError(f"{command[0]} failed: {reason}")
    return done.stdout


def _read_wav(path: Path) -> tuple[Float[np.ndarray, " N"], int]:
    try:
        with wave.open(str(path), "rb") as file:
            samples = np.frombuffer(file.readframes(file.getnframes()), dtype="<i2")
            return samples / 32768.0, file.getframerate()
    except (FileNotFoundError, EOFError) as error:
        raise VoiceError("flite wrote no sound; is there space in the temporary folder?") from error


@dataclass(frozen=True)
class Speaker:
    """Voice and style; plain numbers are factors around 1 unless a unit is in the name."""

    number: int
    name: str
    voice: FliteVoice
    pause: float = 1.0
    """Length of pauses between sentences."""
    dominant: Literal["left", "right"] = "right"
    dominance: float = 0.7
    """Probability that a one-hand gesture uses the dominant hand."""
    amplitude: float = 1.0
    rate: float = 1.0
    """Share of accents with a stroke."""
    height_m: float = 0.0
    """Upward shift of the gesture space (m)."""
    outward_m: float = 0.0
    """Outward shift of the gesture space (m)."""
    forward_m: float = 0.0
    """Forward shift of the gesture space (m)."""
    elbow_out: float = 0.0
    """Sideways lift of the elbows in gestures; negative tucks them in."""
    palm_up: float = 0.0
    """Upward turn of the palms, as a share of a unit vector; negative turns them down."""
    wrist_deg: float = 0.0
    """Habitual bend of the wrist towards the palm (degrees)."""
    two_hands: float = 0.55
    """Probability of two hands for gestures with a free choice."""
    tempo: float = 1.0
    rest: str = "hang"
    other_rest: str = ""
    """Rest and waiting pose of the non-dominant hand; empty for that of the dominant one."""
    listening_rest: str = ""
    """Rest pose of the hands while listening; empty for that in pauses."""
    ready: str = "low"
    """Waiting pose of a hand between gestures."""
    pause_threshold_s: float = 0.7
    """Longest pause (s) without retraction."""
    energy: float = 1.0
    """Strength of accents of head and trunk, and a factor of the liveliness of the hands."""
    sway: float = 1.0
    lean_deg: float = 0.0
    steps: float = 1.0
    smile: float = 0.15
    finger_curl: float = 1.0
    finger_life: float = 1.0
    beats: float = 1.0
    """Share of accents after a stroke with a beat."""
    keyword_gesture_rate: float = 1.0
    """Share of words with a literal gesture that get it."""
    beat_shape: str = "relaxed"
    idle_shape: str = "relaxed"
    favourites: tuple[str, ...] = ()
    """Gestures drawn four times as often where there is no literal gesture."""
    held_out: bool = False
    """True if all clips are in the test split."""

    @property
    def other_hand(self) -> str:
        return SIDES[1] if self.dominant == SIDES[0] else SIDES[0]

    def listening_rest_of(self, side: str) -> str:
        """Return the rest pose of a hand while listening."""
        return self.listening_rest or self.rest_of(side)

    def rest_of(self, side: str) -> str:
        """Return the rest pose of a hand in a pause."""
        return self.other_rest or self.rest if side == self.other_hand else self.rest

    def waiting_of(self, side: str, chance: float) -> str:
        """Return the pose of an idle hand, for a draw between 0 and 1."""
        if side == self.other_hand and self.other_rest:
            return self.other_rest
        return self.ready if chance < 0.7 else self.rest


_FILE = Path(__file__).with_name("speakers.toml")

SPEAKERS: tuple[Speaker, ...] = tuple(
    from_dict(Speaker, entry) for entry in tomllib.loads(_FILE.read_text("utf-8"))["speakers"]
)
