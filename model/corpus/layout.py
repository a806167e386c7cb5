"""Files in BEAT2's layout: motion, sound, annotation and the table of splits.

Every file is written under another name first and moved into place, and holds no time of writing,
so that the same clip gives the same bytes.
"""

import io
import wave
import zipfile
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from jaxtyping import Float

from model.corpus.clip import Clip
from model.corpus.gesture.plan import Key
from model.corpus.people.rig import SIDES
from model.motion.timing import FPS, SAMPLE_RATE
from model.storage.files import write_error, written_atomically

MOTION, SOUND, TEXTGRID = "smplxflame_30", "wave16k", "textgrid"
SPLIT_TABLE = "train_test_split.csv"
EXPRESSION_BASIS = "arkit52"


@dataclass(frozen=True)
class ClipPaths:
    """The three files of a clip."""

    motion: Path
    sound: Path
    textgrid: Path

    def all_exist(self) -> bool:
        return all(path.is_file() for path in (self.motion, self.sound, self.textgrid))


def clip_paths(root: Path, clip_id: str) -> ClipPaths:
    """Where the files of a clip lie under the corpus folder."""
    return ClipPaths(
        root / MOTION / f"{clip_id}.npz",
        root / SOUND / f"{clip_id}.wav",
        root / TEXTGRID / f"{clip_id}.TextGrid",
    )


def write_clip(root: Path, clip_id: str, clip: Clip) -> None:
    """Write the files of a clip, its motion last."""
    paths = clip_paths(root, clip_id)
    write_bytes(paths.sound, wav_bytes(clip.utterance.waveform))
    write_bytes(paths.textgrid, textgrid(clip).encode())
    arrays = {
        "poses": clip.poses,
        "trans": clip.trans,
        "expressions": clip.expressions,
        "betas": np.zeros(300, dtype=np.float32),
        "gender": np.array("neutral"),
        "model": np.array("smplx2020"),
        "mocap_frame_rate": np.array(FPS, dtype=np.int32),
        "expression_basis": np.array(EXPRESSION_BASIS),
    }
    write_bytes(paths.motion, npz_bytes(arrays))


def write_bytes(path: Path, content: bytes) -> None:
    """Write a file whole or not at all, and its folder where there is none.

    Raises:
        WriteError: with the reason.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise write_error(path.parent, error) from error
    with written_atomically(path) as part:
        part.write_bytes(content)


def npz_bytes(arrays: dict[str, np.ndarray]) -> bytes:
    """An uncompressed npz without time stamps."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, array in arrays.items():
            content = io.BytesIO()
            np.lib.format.write_array(content, np.asarray(array, order="C"), allow_pickle=False)
            archive.writestr(zipfile.ZipInfo(f"{name}.npy"), content.getvalue())
    return buffer.getvalue()


def wav_bytes(waveform: Float[np.ndarray, " N"]) -> bytes:
    """A 16 kHz mono PCM_16 wav file; samples beyond -1 to 1 are clipped."""
    samples = np.round(np.clip(waveform, -1.0, 1.0) * 32767.0).astype("<i2")
    buffer = io.BytesIO()
    with wave.open(buffer, "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(SAMPLE_RATE)
        file.writeframes(samples.tobytes())
    return buffer.getvalue()


def split_table(rows: list[tuple[str, str]]) -> str:
    """``train_test_split.csv``: the id and split of every clip."""
    return "id,type\n" + "".join(f"{clip_id},{split}\n" for clip_id, split in rows)


Interval = tuple[float, float, str]


def textgrid(clip: Clip) -> str:
    """A Praat TextGrid: words, phones, gesture phases of each hand, and the strokes' apexes.

    A phase is labelled ``stroke offer``: Kendon's phase, then the gesture's name where it has one.
    """
    duration_s = clip.utterance.duration_s
    words = [(w.start_s, w.end_s, w.text) for w in clip.utterance.words]
    phones = [(p.start_s, p.end_s, p.name) for p in clip.utterance.phones]
    tiers = [
        _interval_tier("words", words, duration_s),
        _interval_tier("phones", phones, duration_s),
    ]
    apexes = []
    for side in SIDES:
        keys = clip.plan.keys[side]
        tiers.append(_interval_tier(f"gesture_{side}", _phases(keys, duration_s), duration_s))
        strokes = [key for key in keys if key.phase == "stroke" and 0 < key.arrive_s < duration_s]
        apexes += [(key.arrive_s, f"{key.gesture} {side}") for key in strokes]
    tiers.append(_point_tier("apex", sorted(apexes), duration_s))
    head = (
        'File type = "ooTextFile"\nObject class = "TextGrid"\n\n'
        f"xmin = 0\nxmax = {duration_s:.4f}\ntiers? <exists>\nsize = {len(tiers)}\nitem []:\n"
    )
    return head + "".join(
        f"    item [{number}]:\n{tier}" for number, tier in enumerate(tiers, start=1)
    )


def _phases(keys: list[Key], duration_s: float) -> list[Interval]:
    """What a hand does when: the moves to its keys, with holds or rests between them."""
    phases: list[Interval] = []
    for before, key in pairwise(keys):
        start_s = max(key.arrive_s - key.duration_s, before.arrive_s)
        still = "rest" if before.phase in ("rest", "retraction") else "hold"
        phases.append((before.arrive_s, start_s, f"{still} {before.gesture}".strip()))
        phases.append((start_s, key.arrive_s, f"{key.phase} {key.gesture}".strip()))
    last = keys[-1]
    still = "rest" if last.phase in ("rest", "retraction") else "hold"
    phases.append((last.arrive_s, duration_s, f"{still} {last.gesture}".strip()))
    return phases


def _interval_tier(name: str, intervals: list[Interval], duration_s: float) -> str:
    """An interval tier that covers the whole clip: gaps are filled with empty intervals."""
    filled: list[Interval] = []
    end_s = 0.0
    for start, end, label in intervals:
        start, end = max(round(start, 4), end_s), min(round(end, 4), round(duration_s, 4))
        if end <= start:
            continue
        if start > end_s:
            filled.append((end_s, start, ""))
        filled.append((start, end, label))
        end_s = end
    if end_s < round(duration_s, 4):
        filled.append((end_s, round(duration_s, 4), ""))
    lines = [
        '        class = "IntervalTier"',
        f'        name = "{name}"',
        "        xmin = 0",
        f"        xmax = {duration_s:.4f}",
        f"        intervals: size = {len(filled)}",
    ]
    for number, (start, end, label) in enumerate(filled, start=1):
        lines += [
            f"        intervals [{number}]:",
            f"            xmin = {start:.4f}",
            f"            xmax = {end:.4f}",
            f'            text = "{label}"',
        ]
    return "\n".join(lines) + "\n"


def _point_tier(name: str, points: list[tuple[float, str]], duration_s: float) -> str:
    lines = [
        '        class = "TextTier"',
        f'        name = "{name}"',
        "        xmin = 0",
        f"        xmax = {duration_s:.4f}",
        f"        points: size = {len(points)}",
    ]
    for number, (time, label) in enumerate(points, start=1):
        lines += [
            f"        points [{number}]:",
            f"            number = {time:.4f}",
            f'            mark = "{label}"',
        ]
    return "\n".join(lines) + "\n"
