"""Speech by the ``flite`` program: a waveform and exact phone times for one sentence."""

import re
import shutil
import subprocess
import tempfile
import wave
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.signal import resample_poly

from conventions.rates import SAMPLE_RATE

PAUSE = "pau"
VOWELS = frozenset("aa ae ah ao aw ax axr ay eh er ey ih ix iy ow oy uh uw".split())


class VoiceError(RuntimeError):
    """flite is missing or did not speak."""


@dataclass(frozen=True)
class FliteVoice:
    """One of flite's voices, changed in pitch, formants and pace."""

    flite_name: str
    f0_hz: float
    f0_sd_hz: float
    formant: float = 1.0  # > 1: a shorter vocal tract
    stretch: float = 1.0  # > 1: slower


@dataclass(frozen=True)
class Phone:
    """A speech sound; ``word`` counts the words of its sentence; ``stress`` is 1 if stressed."""

    name: str
    start_s: float
    end_s: float
    word: int = -1
    stress: int = 0

    @property
    def is_vowel(self) -> bool:
        return self.name in VOWELS


def require_flite() -> None:
    """Raise a sentence that says how to install flite where it is missing."""
    if shutil.which("flite") is None or shutil.which("t2p") is None:
        raise VoiceError(
            "The speech program flite was not found; install it with: apt-get install flite"
        )


def words_of(sentence: str) -> list[str]:
    """The words of a sentence in lower case."""
    return re.findall(r"[a-z']+", sentence.lower())


def say(
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
        raise VoiceError(f"flite found nothing to say in the sentence {sentence!r}.")
    return waveform, align(words_of(sentence), phones)


@lru_cache(maxsize=4096)
def pronounce(word: str) -> tuple[tuple[str, int], ...]:
    """The phones of a word alone, each with 1 if it carries the main stress."""
    phones = [p for p in _run(["t2p", word]).split() if p != PAUSE]
    return tuple((p.rstrip("012"), int(p.endswith("1"))) for p in phones)


def align(words: list[str], phones: list[Phone]) -> list[Phone]:
    """Give every spoken phone its word and stress, by least edit distance to the words alone.

    flite joins and reduces sounds in a sentence, so the lists differ a little.
    """
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
