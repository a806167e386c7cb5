"""A child process that hears English words and their phones, by pocketsphinx.

It is a process of its own because the recogniser is C that cannot be interrupted, and since what
goes wrong there, or takes too long, shall end nothing but this. It takes what is said, or None, and
16-bit samples at 16 kHz, and gives the words, each with its phones.
"""

from __future__ import annotations

import ctypes
import math
import os
import signal
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Int16

from conventions.rates import SAMPLE_RATE
from model.plan.tier_files import Interval
from model.speech.pronouncing import Sayable, words_to_say
from model.speech.transcript import Word
from processes.child import parent_channel

PIECE_S = (8.0, 16.0)
"""The shortest and longest stretch that is decoded at once: memory and time grow with it."""
FRAMES_PER_S = 100
"""Of the recogniser."""
_LOUDNESS_S = 0.2
"""Over which loudness is averaged where a place to cut is looked for."""
_MARGIN_S = 0.15
"""Of sound around the words of an aligned piece."""
_WIDE = {"beam": 1e-150, "pbeam": 1e-150, "wbeam": 1e-150}
"""So that a text is followed through what it leaves out or nobody has said."""
_FIT, _FIT_WIDTH, _FIT_WORDS = -45.0, 8.0, 5
"""Score of a frame, where 0 is the best that any sound has there, at which words of a text are as
likely said as not, and how slowly that changes; it is averaged over so many words, since one may be
said oddly. Spoken ones have -10 to -35 so, others -50 to -130."""
_NO_FIT = -200.0
_PARENT_DEATH_SIGNAL = 1
_FILLERS = "<[+"
"""What names of silence and noise begin with."""


@dataclass
class HeardWord:
    """A word, its times in frames of the recogniser, and its phones."""

    text: str
    start: int
    end: int
    """The frame after its last."""
    confidence: float
    phones: list[tuple[str, int, int]] = field(default_factory=list)

    def moved(self, frames: int) -> HeardWord:
        """The same, later."""
        phones = [(name, start + frames, end + frames) for name, start, end in self.phones]
        return HeardWord(self.text, self.start + frames, self.end + frames, self.confidence, phones)

    def told(self) -> tuple[Word, tuple[Interval, ...]]:
        """As the parent takes it, in seconds."""
        phones = tuple(
            Interval(start / FRAMES_PER_S, end / FRAMES_PER_S, name)
            for name, start, end in self.phones
        )
        start_s, end_s = self.start / FRAMES_PER_S, self.end / FRAMES_PER_S
        return Word(start_s, end_s, self.text, round(self.confidence, 3)), phones


def pieces(waveform: Int16[np.ndarray, " N"]) -> Iterator[tuple[int, int]]:
    """Ranges of samples that cover all of the speech, cut where it is quietest, `PIECE_S` long; the
    last may be shorter."""
    step = SAMPLE_RATE // FRAMES_PER_S
    shortest, longest = (round(FRAMES_PER_S * seconds) for seconds in PIECE_S)
    frames = len(waveform) // step
    if frames <= longest:
        yield 0, len(waveform)
        return
    energy = np.square(waveform[: frames * step].astype(np.float32)).reshape(frames, step).mean(1)
    width = round(FRAMES_PER_S * _LOUDNESS_S)
    loudness = np.convolve(energy, np.ones(width) / width, mode="same")
    start = 0
    while frames - start > longest:
        cut = start + shortest + int(loudness[start + shortest : start + longest].argmin())
        yield start * step, cut * step
        start = cut
    yield start * step, len(waveform)


def recognise(waveform: Int16[np.ndarray, " N"]) -> list[HeardWord]:
    """The words that are most likely said, however unlikely that is."""
    decoder = _decoder()
    found = []
    for start, stop in pieces(waveform):
        sound = waveform[start:stop].tobytes()
        _decode(decoder, sound)
        segments = [segment for segment in decoder.seg() or () if segment.word[0] not in _FILLERS]
        fitted = _fitted(decoder, sound) if segments else []
        decoder.activate_search()
        at = start * FRAMES_PER_S // SAMPLE_RATE
        for number, segment in enumerate(segments):
            word = HeardWord(
                segment.word.split("(")[0], segment.start_frame, segment.end_frame + 1, segment.prob
            )
            if len(fitted) == len(segments):
                word.phones = fitted[number].phones
            found.append(word.moved(at))
    return found


def align(waveform: Int16[np.ndarray, " N"], text: str) -> list[HeardWord]:
    """The words of a text where they are said; none where it cannot be followed at all."""
    decoder = _decoder(lm=None)
    spoken = words_to_say(text, decoder.lookup_word)
    if not spoken:
        return []
    names = _named(decoder, spoken)
    rough = _rough_times(decoder, waveform, names)
    if len(rough) != len(spoken):
        rough = _rough_times(_wide(spoken), waveform, names)
    if len(rough) != len(spoken):
        return []
    found = []
    for first, last, start, stop in _parts(rough, len(waveform) * FRAMES_PER_S // SAMPLE_RATE):
        found += _followed(decoder, waveform, names[first:last], rough[first:last], start, stop)
    for word, each in zip(found, spoken, strict=True):
        word.text = each.text
    for word, likelihood in zip(found, _likelihoods(found), strict=True):
        word.confidence = likelihood
    return found


def _followed(
    decoder: Any,
    waveform: Int16[np.ndarray, " N"],
    names: list[str],
    rough: list[tuple[int, int]],
    start: int,
    stop: int,
) -> list[HeardWord]:
    """The words of a part, whose fit is their confidence so far. Where they cannot be followed,
    each half of them is tried alone, so that one wrong sentence spoils little."""
    step = SAMPLE_RATE // FRAMES_PER_S
    sound = waveform[start * step : stop * step].tobytes()
    decoder.set_align_text(" ".join(names))
    _decode(decoder, sound)
    fitted = _fitted(decoder, sound) if decoder.hyp() is not None else []
    if len(fitted) == len(names):
        return [word.moved(start) for word in fitted]
    if len(names) == 1:
        return [HeardWord("", *rough[0], _NO_FIT)]
    cut = max(
        range(1 + (len(names) - 1) // 3, 1 + 2 * len(names) // 3),
        key=lambda number: rough[number][0] - rough[number - 1][1],
    )
    before, after = rough[cut - 1][1], rough[cut][0]
    margin = round(FRAMES_PER_S * _MARGIN_S)
    return [
        *_followed(decoder, waveform, names[:cut], rough[:cut], start, min(after, before + margin)),
        *_followed(decoder, waveform, names[cut:], rough[cut:], max(before, after - margin), stop),
    ]


def _wide(spoken: list[Sayable]) -> Any:
    decoder = _decoder(lm=None, **_WIDE)
    _named(decoder, spoken)
    return decoder


def _named(decoder: Any, spoken: list[Sayable]) -> list[str]:
    """What each word is called in the dictionary, to which those are added that it lacks."""
    names, added = [], {}
    for word in spoken:
        if word.known is not None:
            names.append(word.known)
            continue
        if word.phones not in added:
            added[word.phones] = f"unknown_{len(added)}"
            decoder.add_word(added[word.phones], word.phones, False)
        names.append(added[word.phones])
    return names


def _rough_times(
    decoder: Any, waveform: Int16[np.ndarray, " N"], names: list[str]
) -> list[tuple[int, int]]:
    """First frame, and the one after the last, of each word; of none where there is no way."""
    decoder.set_align_text(" ".join(names))
    _decode(decoder, waveform.tobytes())
    if decoder.hyp() is None:
        return []
    return [
        (segment.start_frame, segment.end_frame + 1)
        for segment in decoder.seg() or ()
        if segment.word[0] not in _FILLERS
    ]


def _parts(times: list[tuple[int, int]], end: int) -> Iterator[tuple[int, int, int, int]]:
    """Ranges of words with the frames that hold them, cut at the longest pauses."""
    shortest, longest = (round(FRAMES_PER_S * seconds) for seconds in PIECE_S)
    margin = round(FRAMES_PER_S * _MARGIN_S)
    first = 0
    while first < len(times):
        begin = times[first][0]
        last = first + 1
        while last < len(times) and times[last][1] - begin <= longest:
            last += 1
        if last < len(times):
            # A pause before a word; a word alone may be longer than a piece.
            cuts = [n for n in range(first + 1, last + 1) if times[n][0] - begin >= shortest]
            last = max(cuts or [last], key=lambda n: times[n][0] - times[n - 1][1])
        before = times[first - 1][1] if first else 0
        after = times[last][0] if last < len(times) else end
        yield first, last, max(before, begin - margin), min(after, times[last - 1][1] + margin)
        first = last


def _fitted(decoder: Any, sound: bytes) -> list[HeardWord]:
    """The words that were just decoded once more, with their phones, and as confidence the score
    of a frame, of which `_FIT` tells; none where they cannot be followed."""
    try:
        decoder.set_alignment()
        _decode(decoder, sound)
    except RuntimeError:  # no path through this sound reaches the end of its words
        return []
    found = []
    for word in decoder.get_alignment() or ():
        # Phones live no longer than this turn of the loop.
        phones = [(phone.name, phone.start, phone.duration, phone.score) for phone in word]
        if word.name[0] in _FILLERS or not phones:
            continue
        start, end = phones[0][1], phones[-1][1] + phones[-1][2]
        fit = sum(score for *_, score in phones) / max(1, end - start)
        found.append(
            HeardWord(
                word.name,
                start,
                end,
                fit,
                [(name, begin, begin + length) for name, begin, length, _ in phones],
            )
        )
    return found


def _likelihoods(words: list[HeardWord]) -> list[float]:
    """Of words whose confidence is still their fit, by that of each and of its neighbours."""
    fits = np.array([word.confidence for word in words])
    frames = np.array([word.end - word.start for word in words], np.float64)
    reach = _FIT_WORDS // 2
    found = []
    for number in range(len(words)):
        near = slice(max(0, number - reach), number + reach + 1)
        fit = float(np.average(fits[near], weights=frames[near]))
        found.append(1.0 / (1.0 + math.exp((_FIT - fit) / _FIT_WIDTH)))
    return found


def _decode(decoder: Any, sound: bytes) -> None:
    decoder.start_utt()
    try:
        decoder.process_raw(sound, full_utt=True)
    finally:
        decoder.end_utt()


def _decoder(**options: Any) -> Any:
    from pocketsphinx import Decoder

    return Decoder(loglevel="FATAL", **options)


def main() -> None:
    """Hear what the parent sends."""
    os.nice(10)
    # With its parent, however that ends: nothing else runs while the recogniser does.
    ctypes.CDLL(None).prctl(_PARENT_DEATH_SIGNAL, signal.SIGKILL)
    channel, _ = parent_channel()
    text, waveform = channel.recv()
    words = recognise(waveform) if text is None else align(waveform, text)
    channel.send([word.told() for word in words])


if __name__ == "__main__":
    main()
