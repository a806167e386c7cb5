"""Files in BEAT2's layout: motion, sound, annotation and the table of splits.

Every file is written under another name first and moved into place, and holds no time of writing,
so that the same clip gives the same bytes.
"""

import io
import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from conventions.rates import FPS
from model.speech.audio import wav_bytes
from model.storage.files import write_error, written_atomically
from tools.corpus.annotation import textgrid
from tools.corpus.clip import Clip

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


def split_table(rows: list[tuple[str, str]]) -> str:
    """``train_test_split.csv``: the id and split of every clip."""
    return "id,type\n" + "".join(f"{clip_id},{split}\n" for clip_id, split in rows)
