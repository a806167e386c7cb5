"""Face animation from phones and accents: jaw, coarticulated lips, blinks, brows and smiles."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d

from conventions.rates import FPS
from model.plan.plan import Blink, Brow, Gaze, Smile
from tools.corpus.body.signals import frame_times, gaussian_bump, minimum_jerk, smooth_line
from tools.corpus.body.trunk import Trunk
from tools.corpus.people.speaker import PAUSE, Speaker
from tools.corpus.words.prosody import Utterance

FINE = 4  # the mouth is computed at 120 frames a second
MAX_JAW_DEG = 13.0
SMILE_CHANGE_S = 0.8  # duration of a change from one smile level to the next
SMILE_HALF_S = 1.0  # half the duration of a smile around the end of a phrase
WIDE_DEG = 14.0  # smallest gaze shift that attracts a blink

_CLOSED_LIPS = {
    "mouthClose": 0.35,
    "mouthPress": 0.45,
    "mouthRollLower": 0.28,
    "mouthRollUpper": 0.2,
}
# Phones, jaw opening in degrees, dominance over the neighbours, face units.
_VISEMES = (
    ("aa ao aw", 11.0, 1.0, {"mouthLowerDown": 0.35, "mouthUpperUp": 0.12}),
    ("ae ay", 10.0, 1.0, {"mouthStretch": 0.3, "mouthLowerDown": 0.35, "mouthUpperUp": 0.2}),
    ("ah ax axr hh", 5.5, 0.6, {"mouthLowerDown": 0.2}),
    ("eh ey", 7.0, 0.9, {"mouthStretch": 0.32, "mouthSmile": 0.18, "mouthLowerDown": 0.25}),
    ("ih ix", 4.5, 0.7, {"mouthStretch": 0.28, "mouthSmile": 0.15, "mouthLowerDown": 0.15}),
    ("iy y", 3.0, 0.9, {"mouthStretch": 0.42, "mouthSmile": 0.3, "mouthLowerDown": 0.15}),
    ("ow oy", 7.0, 1.1, {"mouthFunnel": 0.55, "mouthPucker": 0.3}),
    ("uw uh", 3.0, 1.2, {"mouthPucker": 0.75, "mouthFunnel": 0.3}),
    ("w", 2.2, 1.3, {"mouthPucker": 0.85, "mouthFunnel": 0.25}),
    ("er r", 4.0, 0.9, {"mouthFunnel": 0.42, "mouthPucker": 0.25}),
    ("p b m", 0.2, 2.4, _CLOSED_LIPS),
    ("f v", 1.6, 2.0, {"mouthRollLower": 0.6, "mouthUpperUp": 0.28, "mouthPress": 0.1}),
    ("th dh", 3.4, 1.0, {"mouthLowerDown": 0.25}),
    ("t d n l", 2.6, 0.7, {"mouthLowerDown": 0.18, "mouthUpperUp": 0.08}),
    ("s z", 1.4, 1.0, {"mouthStretch": 0.32, "mouthLowerDown": 0.25, "mouthUpperUp": 0.12}),
    ("sh zh ch jh", 1.8, 1.2, {"mouthFunnel": 0.62, "mouthUpperUp": 0.15, "mouthLowerDown": 0.2}),
    ("k g ng", 3.8, 0.6, {"mouthLowerDown": 0.15}),
    (PAUSE, 0.6, 0.5, {}),
)
VISEMES = {
    phone: (jaw, dominance, units)
    for phones, jaw, dominance, units in _VISEMES
    for phone in phones.split()
}
MOUTH_UNITS = tuple(sorted({unit for _, _, units in VISEMES.values() for unit in units}))


@dataclass(frozen=True)
class BrowMove(Brow):
    """Brow raise, or frown if negative, as a Gaussian in time."""

    width_s: float
    """Standard deviation (s)."""


@dataclass(frozen=True)
class BlinkMove(Blink):
    """Blink with lids at least half shut for ``duration_s``."""

    duration_s: float


@dataclass(frozen=True)
class FaceCurves:
    """Curves of the face, and the events they are made from."""

    units: Float[np.ndarray, "T E"]
    """Face units from 0 to 1, in the order of the rig's names."""
    jaw: Float[np.ndarray, " T"]
    """Opening of the jaw (rad)."""
    brows: tuple[BrowMove, ...]
    smiles: tuple[Smile, ...]
    blinks: tuple[BlinkMove, ...]


def move_face(
    utterance: Utterance,
    expression_names: tuple[str, ...],
    trunk: Trunk,
    speaker: Speaker,
    rng: np.random.Generator,
) -> FaceCurves:
    """Animate the mouth from phones; brows, smiles and lids from accents, phrases and gaze."""
    num_frames = len(trunk.accent)
    time_s = frame_times(num_frames)
    jaw_deg, mouth = _mouth(utterance, num_frames)
    jaw_deg *= 1 + smooth_line(rng, num_frames, 0.04, 0.67)
    units = dict(zip(MOUTH_UNITS, mouth.T, strict=True))
    brows = _brows(utterance, rng)
    brow = smooth_line(rng, num_frames, 0.02, 0.5)
    for move in brows:
        brow += move.height * gaussian_bump(time_s, move.time_s, move.width_s)
    smiles = _smiles(utterance, speaker, rng)
    smile = _smile_curve(smiles, time_s)
    units["browInnerUp"] = np.clip(brow, 0, 0.8)
    units["browOuterUp"] = np.clip(0.8 * brow, 0, 0.7)
    units["eyeWide"] = np.clip(0.3 * brow, 0, 0.3)
    units["mouthSmile"] = units["mouthSmile"] + smile
    units["cheekSquint"] = 0.4 * smile
    units["browDown"] = np.clip(-brow, 0, 0.5)
    lids = np.clip(trunk.eyes_deg[:, 0] / 60, 0, 0.25)
    blinks = _blinks(trunk.gaze, utterance.duration_s, rng)
    units["eyeBlink"] = _closed_lids(blinks, time_s) + lids
    columns = np.zeros((num_frames, len(expression_names)))
    for k, name in enumerate(expression_names):
        unit = name.removesuffix("Left").removesuffix("Right")
        if name in units or unit in units:
            columns[:, k] = units.get(name, units.get(unit))
    jaw = np.radians(np.clip(0.82 * jaw_deg, 0, MAX_JAW_DEG))
    return FaceCurves(np.clip(columns, 0, 1), jaw, brows, smiles, blinks)


def _mouth(
    utterance: Utterance, num_frames: int
) -> tuple[Float[np.ndarray, " T"], Float[np.ndarray, "T U"]]:
    """Compute jaw (degrees) and mouth units as dominance-weighted means (Cohen, Massaro 1993)."""
    fine_s = np.arange(num_frames * FINE) / (FPS * FINE)
    weighted = np.zeros((len(fine_s), 1 + len(MOUTH_UNITS)))
    total = np.full(len(fine_s), 1e-3)
    weighted[:, 0] = 1e-3 * VISEMES[PAUSE][0]
    for phone in utterance.phones:
        jaw, dominance, units = VISEMES.get(phone.name, VISEMES["ah"])
        centre = 0.5 * (phone.start_s + phone.end_s) - 0.02
        half = max(0.5 * (phone.end_s - phone.start_s), 0.03)
        near = slice(*np.searchsorted(fine_s, [centre - half - 0.35, centre + half + 0.35]))
        distance = np.abs(fine_s[near] - centre)
        weight = dominance * np.exp(-((distance / (1.05 * half + 0.012)) ** 1.6))
        accent = utterance.words[phone.word].accent if phone.word >= 0 else 0.0
        gain = 1 + 0.35 * accent if phone.stress else 0.92
        weighted[near, 0] += weight * jaw * gain
        total[near] += weight
        for unit, value in units.items():
            weighted[near, 1 + MOUTH_UNITS.index(unit)] += weight * value * min(gain, 1.25)
    mouth = gaussian_filter1d(weighted / total[:, None], 0.022 * FPS * FINE, axis=0)[::FINE]
    return mouth[:, 0], mouth[:, 1:]


def _brows(utterance: Utterance, rng: np.random.Generator) -> tuple[BrowMove, ...]:
    """Draw brow raises on about half of the strong accents, and a frown every few seconds."""
    moves = []
    for word in utterance.words:
        if word.accent > 0.75 and rng.random() < 0.55:
            height = word.accent * rng.uniform(0.18, 0.6)
            moves.append(BrowMove(word.beat_s + 0.08, float(height), float(rng.uniform(0.1, 0.22))))
    at_s = rng.uniform(0, 6)
    while at_s < utterance.duration_s:
        width_s = rng.uniform(0.4, 1.0)
        moves.append(BrowMove(float(at_s), -float(rng.uniform(0.08, 0.28)), float(width_s)))
        at_s += rng.uniform(3.0, 9.0)
    return tuple(sorted(moves, key=lambda move: move.time_s))


def _smiles(utterance: Utterance, speaker: Speaker, rng: np.random.Generator) -> tuple[Smile, ...]:
    """Draw the speaker's own smile, more or less of it about the end of each phrase."""
    own = 0.6 * speaker.smile
    smiles, at_s = [], 0.0
    for phrase in utterance.phrases:
        level = float(np.clip(own + max(rng.normal(speaker.smile, 0.18), -0.1), 0, 0.6))
        start_s = max(phrase.end_s - SMILE_HALF_S, at_s)
        end_s = min(phrase.end_s + SMILE_HALF_S, utterance.duration_s)
        if end_s - start_s < 0.5 * SMILE_HALF_S:
            continue
        smiles += [Smile(at_s, start_s, own), Smile(start_s, end_s, level)]
        at_s = end_s
    smiles.append(Smile(at_s, utterance.duration_s, own))
    return tuple(smile for smile in smiles if smile.end_s > smile.start_s)


def _smile_curve(
    smiles: tuple[Smile, ...], time_s: Float[np.ndarray, " T"]
) -> Float[np.ndarray, " T"]:
    """Return the smile level, with each change centred on the end of a smile."""
    curve = np.full(len(time_s), smiles[0].size)
    for before, after in pairwise(smiles):
        phase = (time_s - after.start_s) / SMILE_CHANGE_S + 0.5
        curve += (after.size - before.size) * minimum_jerk(phase)
    return curve


def _blinks(
    gaze: tuple[Gaze, ...], duration_s: float, rng: np.random.Generator
) -> tuple[BlinkMove, ...]:
    """Draw about twenty blinks a minute, some at wide gaze shifts."""
    wide = [
        after.start_s
        for before, after in pairwise(gaze)
        if abs(after.yaw_deg - before.yaw_deg) + abs(after.pitch_deg - before.pitch_deg) > WIDE_DEG
    ]
    times: list[float] = []
    at_s = rng.uniform(0.4, 2.8)
    while at_s < duration_s - 0.1:
        near = [shift for shift in wide if abs(shift - at_s) < 0.6]
        times.append(float(near[0] if near and rng.random() < 0.7 else at_s))
        at_s = times[-1] + 1.4 + rng.gamma(5.0, 0.32)
    return tuple(BlinkMove(time, float(rng.uniform(0.1, 0.15))) for time in times)


def _closed_lids(
    blinks: tuple[BlinkMove, ...], time_s: Float[np.ndarray, " T"]
) -> Float[np.ndarray, " T"]:
    """Return lid closure, with a third of the blink for closing and two thirds for opening."""
    closed = np.zeros(len(time_s))
    half = np.sqrt(np.log(2.0))
    for blink in blinks:
        since = time_s - blink.time_s
        width = np.where(since < 0, blink.duration_s / 3, 2 * blink.duration_s / 3) / half
        closed = np.maximum(closed, np.exp(-((since / width) ** 2)))
    return closed
