"""Recognition or alignment of English words and phones in a child process (`word_alignment`)."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32

from conventions.rates import SAMPLE_RATE
from model.plan.annotation_files import Interval
from model.speech.transcript import EMPTY_TRANSCRIPT, Transcript, TranscriptSource, Word
from processes.child import Child, ChildExited
from processes.exit_report import ExitReport

MIN_CONFIDENCE = 0.5
"""Confidence below which a word is left out. Of words recognised in clear speech about nine in ten
above it are right, and six in ten below it (docs/words.md)."""
LONGEST_WORD_S = 2.5
"""Longest plausible word (s). From a faint hum alone the recogniser reports with certainty an
eight-second "dog"."""
MIN_CONFIDENT_SHARE = 0.4
"""Share of sure words below which none is used: English has 0.5 to 0.9 in eleven clips, French 0.2,
and speech played backwards 0.1 to 0.4."""
MIN_WORDS_FOR_LANGUAGE = 8
"""Number of words below which the language of the speech cannot be judged."""
MAX_WORDS_A_SECOND = 8
"""Fastest plausible speech; a text with more words belongs to another recording."""
TIMEOUT_S = (60.0, 6.0)
"""Time limit (s): a constant, and an amount per second of speech. Recognition takes 0.3 s per
second on one free core."""

UNSURE_NOTE = (
    "{unsure} of {count} recognised words are uncertain: the speech is probably not in English, or "
    "hard to understand. No words are used; motion and metrics do not need them."
)
FEW_NOTE = "{unsure} of {count} recognised words were uncertain and are left out."
SILENT_NOTE = "No words were recognised in the speech."
MISMATCH_NOTE = (
    "The text does not match the speech: {found}. Its words are not used; give the spoken words "
    "in English and in order."
)
PART_NOTE = (
    "{unsure} of the {count} words of the text were not found in the speech and are left out."
)
FAILED_NOTE = "The results contain no words, because finding them in the speech failed: {why}."


@dataclass(frozen=True)
class RecognitionResult:
    """Transcript from recognition or alignment, with notes for the user."""

    transcript: Transcript = EMPTY_TRANSCRIPT
    notes: tuple[str, ...] = ()


class WordRecognition:
    """A running recognition or alignment in a child process, ended by leaving the context.

    Any failure becomes a note in the result.
    """

    def __init__(self, waveform: Float32[np.ndarray, " N"], text: str | None = None) -> None:
        """Start the alignment of a text, or the recognition without one."""
        self._is_aligned = text is not None
        self._result: RecognitionResult | None = None
        self._child: Child | None = None
        duration_s = len(waveform) / SAMPLE_RATE
        self._ends = time.monotonic() + TIMEOUT_S[0] + TIMEOUT_S[1] * duration_s
        count = len((text or "").split())
        if count > MAX_WORDS_A_SECOND * (duration_s + 1.0):
            problem = f"it has {count} words, too many for {duration_s:.1f} s"
            self._result = RecognitionResult(notes=(MISMATCH_NOTE.format(found=problem),))
            return
        try:
            self._child = Child("model.speech.word_alignment")
        except OSError as error:
            why = (error.strerror or str(error)).lower()
            self._result = _failed(f"no process could be started ({why})")
            return
        self._child.send((text, (np.clip(waveform, -1.0, 1.0) * 32767).astype("<i2")))

    def __enter__(self) -> WordRecognition:
        return self

    def __exit__(self, *_: object) -> None:
        if self._child is not None:
            self._child.kill()

    def is_over(self, wait_s: float = 0.0) -> bool:
        """Check whether the result is ready, waiting at most ``wait_s`` seconds."""
        if self._result is None and self._child is not None:
            try:
                if self._child.has_message(wait_s):
                    self._result = _judged(self._child.receive(), self._is_aligned)
                elif time.monotonic() > self._ends:
                    self._result = _failed("it took too long")
            except ChildExited:
                self._result = _failed(_reason(self._child.exit_report()))
        return self._result is not None

    def result(self) -> RecognitionResult:
        """Wait for the result and return it. It never raises."""
        while not self.is_over(0.5):
            pass
        assert self._result is not None
        return self._result


def _failed(why: str) -> RecognitionResult:
    return RecognitionResult(notes=(FAILED_NOTE.format(why=why),))


def _reason(ended: ExitReport) -> str:
    last = "".join(ended.log_lines[-1:])
    if "No module named 'pocketsphinx'" in last:
        return "the package pocketsphinx is not installed; python -m pip install pocketsphinx"
    return f"the recogniser ended {ended.exit_text}{last and f' ({last})'}"


def _is_sure(word: Word) -> bool:
    return word.confidence >= MIN_CONFIDENCE and word.end_s - word.start_s <= LONGEST_WORD_S


def _judged(words: list[tuple[Word, tuple[Interval, ...]]], is_aligned: bool) -> RecognitionResult:
    """Return the words that are sure, or none if too many are unsure."""
    sure = [(word, phones) for word, phones in words if _is_sure(word)]
    count, unsure = len(words), len(words) - len(sure)
    share = len(sure) / max(1, count)
    if is_aligned and share < MIN_CONFIDENT_SHARE:
        problem = f"{unsure} of its {count} words were not found"
        return RecognitionResult(
            notes=(
                MISMATCH_NOTE.format(found=problem if words else "none of its words were found"),
            )
        )
    if count >= MIN_WORDS_FOR_LANGUAGE and share < MIN_CONFIDENT_SHARE:
        return RecognitionResult(notes=(UNSURE_NOTE.format(unsure=unsure, count=count),))
    if not sure:
        return RecognitionResult(notes=(SILENT_NOTE,))
    notes: tuple[str, ...] = ()
    if unsure:
        note = PART_NOTE if is_aligned else FEW_NOTE
        notes = (note.format(unsure=unsure, count=count),)
    origin: TranscriptSource = "aligned" if is_aligned else "recognised"
    phones = tuple(phone for _, phones in sure for phone in phones)
    words_sure = tuple(word for word, _ in sure)
    return RecognitionResult(Transcript(words_sure, origin=origin, phones=phones), notes)
