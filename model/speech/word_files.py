"""Parsers of timed words and captions.

They read tables of times (GENEA, Whisper, Audacity, HTK), CTM, SRT, WebVTT, and the JSON of
Whisper, WhisperX and Gentle.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping
from typing import Any

from model.plan.annotation_files import Interval

DEFAULT_WORD_DURATION_S = 0.01
"""Duration (s) of a word that a recogniser wrote with equal start and end."""
_NUMBER = r"(\d+(?:\.\d*)?(?:[eE][-+]?\d+)?)"
_TABLE_ROW = re.compile(rf"\s*{_NUMBER}[\t ]+{_NUMBER}[\t ]+(\S.*)")
_MILLISECONDS = re.compile(r"start\tend\ttext", re.IGNORECASE)
"""Header of the tables that Whisper writes."""
_HTK_S = 1e-7
"""Unit of the whole numbers in HTK's label files."""
_CLOCK = r"(?:(\d{1,4}):)?(\d{1,2}):(\d{1,2})[.,](\d{1,3})"
_CUE = re.compile(rf"\s*{_CLOCK}\s*-->\s*{_CLOCK}")
_MARKUP = re.compile(r"<[^<>]*>|\{\\[^{}]*\}")
_SILENCES = {"sil", "sp", "pau", "<eps>", "<sil>", "#"}


def parse_labels(text: str, is_label_file: bool = False) -> list[Interval] | None:
    """Parse lines of start, end and label in seconds.

    Times are milliseconds below Whisper's header, and units of 100 ns in a label file (.lab) of
    whole numbers. Returns None if any line is not of this form.
    """
    lines = [line for line in text.splitlines() if line.strip()]
    unit_s = 1.0
    if lines and _MILLISECONDS.fullmatch(lines[0].strip()):
        unit_s, lines = 1e-3, lines[1:]
    matches = [_TABLE_ROW.fullmatch(line) for line in lines]
    rows = [match for match in matches if match is not None]
    if not rows or len(rows) < len(matches):
        return None
    if is_label_file and all(match[k].isdigit() for match in rows for k in (1, 2)):
        unit_s = _HTK_S
    spans = [(float(match[1]) * unit_s, float(match[2]) * unit_s, match[3]) for match in rows]
    return list(_labelled(spans))


def parse_ctm(text: str, name: str, error: type[ValueError]) -> list[Interval]:
    """Parse lines of recording, channel, start, duration (s) and word; raises ``error``."""
    spans: list[tuple[float, float, str]] = []
    recordings: dict[str, None] = {}
    for number, line in enumerate(text.splitlines(), 1):
        columns = line.split()
        if not columns or line.startswith(";;"):
            continue
        times = [_number(column) for column in columns[2:4]]
        if len(columns) < 5 or None in times:
            raise error(
                f"Line {number} of {name} must hold recording, channel, start, duration and word."
            )
        start_s, duration_s = (time or 0.0 for time in times)
        recordings[f"{columns[0]} {columns[1]}"] = None
        spans.append((start_s, start_s + duration_s, columns[4]))
    if len(recordings) > 1:
        few = ", ".join(each[:40] for each in list(recordings)[:4])
        raise error(
            f"{name} has words of {len(recordings)} recordings or channels ({few}); keep one of "
            "them."
        )
    return list(_labelled(spans))


def parse_captions(text: str) -> list[Interval]:
    """Parse the cues of SRT or WebVTT, without their markup; other lines are skipped."""
    spans: list[tuple[float, float, str]] = []
    lines = iter(text.splitlines())
    for line in lines:
        cue = _CUE.match(line)
        if cue is None:
            continue
        words: list[str] = []
        for more in lines:
            if not more.strip():
                break
            words.append(_MARKUP.sub("", more).strip())
        spans.append((_clock(cue.groups()[:4]), _clock(cue.groups()[4:]), " ".join(words).strip()))
    return list(_labelled(spans))


def parse_recogniser_json(
    text: str, name: str, error: type[ValueError]
) -> tuple[list[Interval], int]:
    """Parse the words of Whisper, WhisperX or Gentle, or else the segments of Whisper.

    Returns words or segments, and the number of words without times, which are left out. Raises
    ``error`` if the text is none of these.
    """
    try:
        content = json.loads(text)
    except (ValueError, RecursionError):
        content = None
    if not isinstance(content, dict):
        raise error(
            f"{name} is not a JSON file of Whisper, WhisperX or Gentle with words or segments."
        )
    segments = list(_dicts(content.get("segments")))
    words = [word for segment in segments for word in _dicts(segment.get("words"))]
    has_words = bool(words) and all(
        segment.get("words") or not str(segment.get("text", "")).strip() for segment in segments
    )
    if not has_words:
        words = [*_dicts(content.get("word_segments")), *_dicts(content.get("words"))] or segments
    spans: list[tuple[float, float, str]] = []
    num_untimed = 0
    for word in words:
        label = next((word[key] for key in ("word", "text") if isinstance(word.get(key), str)), "")
        start_s, end_s = (_number(word.get(key)) for key in ("start", "end"))
        if start_s is None or end_s is None:
            num_untimed += bool(label.strip())
        else:
            spans.append((start_s, end_s, label))
    if not spans:
        raise error(f"{name} has no words or segments with a start and an end.")
    return list(_labelled(spans)), num_untimed


def _labelled(spans: list[tuple[float, float, str]]) -> Iterator[Interval]:
    for start_s, end_s, label in spans:
        if (label := label.strip()) and label not in _SILENCES:
            yield Interval(
                start_s, end_s if end_s != start_s else start_s + DEFAULT_WORD_DURATION_S, label
            )


def _number(value: object) -> float | None:
    """Convert a number or numeric text to a finite float; None if it is neither."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    try:
        number = float(value)
    except (ValueError, OverflowError):
        return None
    return number if math.isfinite(number) else None


def _clock(parts: tuple[str | None, ...]) -> float:
    hours, minutes, seconds, fraction = parts
    whole = 3600 * int(hours or 0) + 60 * int(minutes or 0) + int(seconds or 0)
    return whole + float(f"0.{fraction}")


def _dicts(value: object) -> Iterator[Mapping[str, Any]]:
    """Yield the dictionaries in a list; nothing if the value is not a list."""
    if isinstance(value, list):
        yield from (each for each in value if isinstance(each, dict))
