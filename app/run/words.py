"""The words of a run's speech: given with their times, or looked for while the run goes on."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from app.run.ask import WordsAsked
from model.speech.recognised import Hearing
from model.speech.transcript import NOTHING_SAID, Transcript, read_words

_LOOK_EVERY_S = 0.1


class SpokenWords:
    """Of one run: a TextGrid wins, then a plain text, then what is recognised, if that is asked
    for. Use it as a context: leaving it ends the looking for words."""

    def __init__(self, given: Path | Transcript | None, asked: WordsAsked) -> None:
        """
        Raises:
            TranscriptError: if the transcript cannot be used.
        """
        self._given = read_words(given) if isinstance(given, Path) else given
        self._asked: WordsAsked = asked
        self._hearing: Hearing | None = None

    def __enter__(self) -> SpokenWords:
        return self

    def __exit__(self, *_: Any) -> None:
        if self._hearing is not None:
            self._hearing.__exit__()

    @property
    def given(self) -> Transcript:
        """What a transcript tells at once: nothing of a plain text, whose words are still to be
        found."""
        return self._given if isinstance(self._given, Transcript) else NOTHING_SAID

    @property
    def need_speech(self) -> bool:
        """Whether words are to be looked for in the speech."""
        if self._given is None:
            return self._asked == "recognise"
        return isinstance(self._given, str)

    def begin(self, waveform: np.ndarray) -> None:
        """Look for them in this speech, if they are to be looked for and are not yet, and return at
        once."""
        if self.need_speech and self._hearing is None:
            text = self._given if isinstance(self._given, str) else None
            self._hearing = Hearing(waveform, text)

    def found(self, on_wait: Callable[[], None]) -> tuple[Transcript, tuple[str, ...]]:
        """What was said, with what a person should know of it.

        Args:
            on_wait: called again and again while they are still looked for; what it raises ends
                that.
        """
        if self._hearing is None:
            return self.given, ()
        while not self._hearing.is_over(_LOOK_EVERY_S):
            on_wait()
        heard = self._hearing.heard()
        return heard.transcript, heard.notes
