"""The face from phones and accents: jaw, lips with coarticulation, blinks, brows and smiles."""

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d

from model.corpus.body.signals import frame_times, gaussian_bump, smooth_line
from model.corpus.body.trunk import Trunk
from model.corpus.people.speakers import Speaker
from model.corpus.people.voice import PAUSE
from model.corpus.words.prosody import Utterance
from model.motion.timing import FPS

FINE = 4  # the mouth is computed at 120 frames a second
MAX_JAW_DEG = 13.0

_CLOSED_LIPS = {
    **{"mouthClose": 0.35, "mouthPress": 0.45, "mouthRollLower": 0.28, "mouthRollUpper": 0.2}
}
# phones: jaw opening in degrees, dominance over the neighbours, face units
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


def move_face(
    utterance: Utterance,
    expression_names: tuple[str, ...],
    trunk: Trunk,
    speaker: Speaker,
    rng: np.random.Generator,
) -> tuple[Float[np.ndarray, "T E"], Float[np.ndarray, " T"]]:
    """Face units from 0 to 1 in the order of ``expression_names``, and the jaw angle in radians."""
    num_frames = len(trunk.accent)
    time_s = frame_times(num_frames)
    jaw_deg, mouth = _mouth(utterance, num_frames)
    jaw_deg *= 1 + smooth_line(rng, num_frames, 0.04, 0.67)
    units = dict(zip(MOUTH_UNITS, mouth.T, strict=True))
    brow = _brows(utterance, time_s, rng)
    smile = _smile(utterance, time_s, speaker, rng)
    units["browInnerUp"] = np.clip(brow, 0, 0.8)
    units["browOuterUp"] = np.clip(0.8 * brow, 0, 0.7)
    units["eyeWide"] = np.clip(0.3 * brow, 0, 0.3)
    units["mouthSmile"] = units["mouthSmile"] + smile
    units["cheekSquint"] = 0.4 * smile
    units["browDown"] = np.clip(smooth_line(rng, num_frames, 0.13, 0.83), 0, 0.3)
    lids = np.clip(trunk.eyes_deg[:, 0] / 60, 0, 0.25)
    units["eyeBlink"] = _blinks(trunk, time_s, rng) + lids
    columns = np.zeros((num_frames, len(expression_names)))
    for k, name in enumerate(expression_names):
        unit = name.removesuffix("Left").removesuffix("Right")
        if name in units or unit in units:
            columns[:, k] = units.get(name, units.get(unit))
    jaw = np.radians(np.clip(0.82 * jaw_deg, 0, MAX_JAW_DEG))
    return np.clip(columns, 0, 1), jaw


def _mouth(
    utterance: Utterance, num_frames: int
) -> tuple[Float[np.ndarray, " T"], Float[np.ndarray, "T U"]]:
    """Jaw in degrees and mouth units as dominance-weighted means (Cohen and Massaro 1993)."""
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


def _brows(
    utterance: Utterance, time_s: Float[np.ndarray, " T"], rng: np.random.Generator
) -> Float[np.ndarray, " T"]:
    """Brows up on about half of the strong accents."""
    brow = np.zeros(len(time_s))
    for word in utterance.words:
        if word.accent > 0.75 and rng.random() < 0.55:
            since = time_s - word.beat_s
            rise = 1 / (1 + np.exp(-np.clip((since + 0.12) / 0.05, -30, 30)))
            fall = np.exp(-np.maximum(since - 0.15, 0) / 0.22)
            brow += word.accent * rng.uniform(0.15, 0.5) * rise * fall
    return brow


def _smile(
    utterance: Utterance,
    time_s: Float[np.ndarray, " T"],
    speaker: Speaker,
    rng: np.random.Generator,
) -> Float[np.ndarray, " T"]:
    """The speaker's own smile, more or less of it at the end of each phrase."""
    smile = np.full(len(time_s), 0.6 * speaker.smile)
    for phrase in utterance.phrases:
        size = max(rng.normal(speaker.smile, 0.18), -0.1)
        smile += size * gaussian_bump(time_s, phrase.end_s, 0.7)
    return np.clip(gaussian_filter1d(smile, 6), 0, 0.6)


def _blinks(
    trunk: Trunk, time_s: Float[np.ndarray, " T"], rng: np.random.Generator
) -> Float[np.ndarray, " T"]:
    """Blinks at random and with half of the wide gaze shifts: they close faster than they open."""
    times = [a for a, degrees in trunk.gaze_shifts if degrees > 14 and rng.random() < 0.5]
    at_s = rng.uniform(0.5, 2.0)
    while at_s < time_s[-1]:
        times.append(at_s)
        at_s += rng.gamma(2.2, 1.5) + 0.5
    closed = np.zeros(len(time_s))
    for blink_s in times:
        since = time_s - blink_s
        width = np.where(since < 0, 0.045, 0.085)
        closed = np.maximum(closed, np.exp(-((since / width) ** 2)))
    return closed
