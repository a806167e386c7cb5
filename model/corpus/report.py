"""``python -m model.corpus.report --data DIR [--real DIR] [--out FILE]``: the corpus in figures.

Writes a Markdown page with the statistics of the speakers beside those of real clips, how well
speakers and speech can be told by motion, and pictures of gestures and speakers beside it.
"""

import argparse
import csv
import sys
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np
from jaxtyping import Float
from tqdm import tqdm

from model.corpus.build import MANIFEST, CorpusError, read_manifest
from model.corpus.drawing import draw_filmstrips, draw_gestures
from model.corpus.judging import (
    alignment_scores,
    hand_speed,
    ridge_weights,
    separability,
    sound_features,
)
from model.corpus.layout import MOTION, SOUND, SPLIT_TABLE, write_bytes
from model.corpus.rig import open_body_rig
from model.corpus.statistics import (
    PosedClip,
    clip_statistics,
    read_posed_clip,
    window_features,
)

SHIFT_S = 7.0
EDGE = slice(30, -30)  # a second at both ends is left out of correlations


class ReportError(ValueError):
    """A report that cannot be made."""


@dataclass(frozen=True)
class ClipFile:
    """A clip of a data folder."""

    clip_id: str
    motion: Path
    sound: Path

    @property
    def speaker(self) -> str:
        return self.clip_id.split("_")[1]


def list_clips(root: Path) -> list[ClipFile]:
    """The clips in a folder of BEAT2's layout that have motion and sound.

    Raises:
        ReportError: if there are none.
    """
    clips = []
    table = root / SPLIT_TABLE
    if table.is_file():
        with table.open(newline="") as file:
            for row in csv.DictReader(file):
                clip_id = row["id"]
                motion = root / MOTION / f"{clip_id}.npz"
                sound = root / SOUND / f"{clip_id}.wav"
                if motion.is_file() and sound.is_file():
                    clips.append(ClipFile(clip_id, motion, sound))
    if not clips:
        raise ReportError(
            f"{root} holds no clips in BEAT2's layout ({MOTION}, {SOUND}, {SPLIT_TABLE})."
        )
    return clips


def write_report(data: Path, real: Path | None, out: Path, clips_per_speaker: int) -> None:
    """Measure up to so many clips of each speaker and write the page with its pictures."""
    rig = open_body_rig()
    by_speaker: dict[str, list[ClipFile]] = {}
    for clip in list_clips(data):
        by_speaker.setdefault(clip.speaker, []).append(clip)
    chosen = {name: clips[:clips_per_speaker] for name, clips in by_speaker.items()}
    total = sum(len(clips) for clips in chosen.values())
    posed: dict[str, list[PosedClip]] = {}
    with tqdm(total=total, unit="clip", desc="Measuring") as bar:
        for name, clips in chosen.items():
            posed[name] = []
            for clip in clips:
                posed[name].append(read_posed_clip(clip.motion, rig))
                bar.update()
    real_clips = [] if real is None else list_clips(real)
    columns = {
        clip.clip_id: clip_statistics(read_posed_clip(clip.motion, rig)) for clip in real_clips
    }
    for name, clips in posed.items():
        every = [clip_statistics(clip) for clip in clips]
        columns[name] = {key: float(np.median([one[key] for one in every])) for key in every[0]}
    pictures = out.parent / "figures"
    draw_gestures(rig, pictures / "corpus_gestures.png")
    strips = {name: (clips[0].global_rot, clips[0].positions) for name, clips in posed.items()}
    draw_filmstrips(rig, strips, pictures / "corpus_speakers.png")
    page = "\n".join(
        [
            _HEAD,
            _statistics_table(columns, len(real_clips)),
            _about(data, chosen),
            _separability_text(posed),
            _alignment_text(chosen, posed),
            _TAIL,
        ]
    )
    write_bytes(out, page.encode())


def _statistics_table(columns: dict[str, dict[str, float]], num_real: int) -> str:
    names = list(columns)
    titles = [f"**{name}**" if k < num_real else name for k, name in enumerate(names)]
    lines = ["| figure | " + " | ".join(titles) + " |", "|---|" + "---|" * len(names)]
    for key in columns[names[0]]:
        cells = [_short(columns[name][key]) for name in names]
        lines.append(f"| {key} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def _short(value: float) -> str:
    """Three significant digits without an exponent."""
    digits = 0 if value == 0 else max(0, 2 - int(np.floor(np.log10(abs(value)))))
    return f"{value:.{min(digits, 4)}f}"


def _about(data: Path, chosen: dict[str, list[ClipFile]]) -> str:
    manifest = data / MANIFEST
    seed = f" of seed {read_manifest(manifest)['seed']}" if manifest.is_file() else ""
    count = sum(len(clips) for clips in chosen.values())
    return f"Medians over {count} clips{seed} of {len(chosen)} speakers; real clips are in bold.\n"


def _separability_text(posed: dict[str, list[PosedClip]]) -> str:
    """Every pair of speakers, trained on every other clip and tested on the rest."""
    windows = {
        name: [window_features(clip) for clip in clips]
        for name, clips in posed.items()
        if len(clips) >= 2
    }
    if len(windows) < 2:
        return "## Are the speakers apart?\n\nToo few clips to say.\n"
    scores: dict[tuple[str, str], float] = {}
    for a, b in combinations(windows, 2):
        train = [np.concatenate(windows[name][0::2]) for name in (a, b)]
        test = [np.concatenate(windows[name][1::2]) for name in (a, b)]
        scores[a, b] = separability(*train, *test)
    values = np.array(list(scores.values()))
    worst = sorted(scores, key=lambda pair: scores[pair])[:5]
    listed = ", ".join(f"{a} and {b} {scores[a, b]:.2f}" for a, b in worst)
    return (
        "## Are the speakers apart?\n\n"
        "A linear discriminant on the means of hand places, speeds and finger curl in windows of"
        " 4 s, trained on half of the clips of two speakers and tested on the other half, tells"
        f" them apart with an area under the curve of {np.median(values):.2f} in the median of"
        f" {len(values)} pairs; {np.mean(values >= 0.8):.0%} of the pairs reach .80. Nearest to"
        f" each other: {listed}.\n"
    )


def _alignment_text(chosen: dict[str, list[ClipFile]], posed: dict[str, list[PosedClip]]) -> str:
    """Hand speed predicted from sound: right speech against shifted speech."""
    features: list[Float[np.ndarray, "_ F"]] = []
    targets: list[Float[np.ndarray, " _"]] = []
    for name, clips in chosen.items():
        for clip, motion in zip(clips, posed[name], strict=True):
            features.append(sound_features(clip.sound, len(motion.positions))[EDGE])
            targets.append(hand_speed(motion)[EDGE])
    if len(features) < 4:
        return "## Does the motion belong to the speech?\n\nToo few clips to say.\n"
    weights = ridge_weights(features[0::2], targets[0::2])
    right, shifted = alignment_scores(weights, features[1::2], targets[1::2], SHIFT_S)
    gain = right - shifted
    half_width = 1.96 * gain.std(ddof=1) / np.sqrt(len(gain))
    return (
        "## Does the motion belong to the speech?\n\n"
        "Hand speed predicted from 12 bands of sound (ridge regression over 0.8 s to either side,"
        f" trained on half of the clips) correlates with the true speed at {right.mean():.3f} on"
        f" the other {len(gain)} clips, and at {shifted.mean():.3f} when the speech is shifted by"
        f" {SHIFT_S:g} s: a difference of {gain.mean():.3f} with a 95 % interval of"
        f" {gain.mean() - half_width:.3f} to {gain.mean() + half_width:.3f}.\n"
    )


_HEAD = """# The procedural corpus in figures

Made by `python -m model.corpus.report`; do not edit by hand. What the corpus is and how it is made
is told in `model/corpus/`, from `texts.py` to `layout.py`.

Real clips, where there are any, are one man's minutes from BEAT2's test split. They guide tuning;
nothing measured on them is a test result, and no frame of them is in the corpus.

## Statistics
"""

_TAIL = """## Pictures

Every gesture at the end of its stroke; orange is the right hand, blue the left.

![gestures](figures/corpus_gestures.png)

Eight frames, half a second apart, of a clip of each speaker.

![speakers](figures/corpus_speakers.png)

## Known faults

- Speech is flite's: clear, but flat and never hesitant. Accents are raised by level and pitch.
- Fingertips jerk about a third less than those of lively real people, shoulders of quick speakers
  turn faster than theirs.
- Knees stay bent by some 40 degrees where standing people bend them by 10, and because legs reach
  their full stretch softly a planted foot floats by up to 7 mm.
- The hands never touch the body, each other or a thing; folded hands hover 15 cm apart.
- Keyword gestures are literal: "two" always shows two fingers.
- Faces blink, speak, smile and raise brows; they do not show feelings that the text has.
- No listener: gaze wanders about one point, and turns are never taken.
"""


def main(argv: list[str] | None = None) -> int:
    """Make the report; 0 when done, 1 with a sentence when it failed, 2 for wrong arguments."""
    parser = argparse.ArgumentParser(
        prog="python -m model.corpus.report", description="Describe a corpus in figures."
    )
    parser.add_argument("--data", type=Path, required=True, help="corpus folder")
    parser.add_argument("--real", type=Path, help="folder of real BEAT2 clips to compare with")
    parser.add_argument("--out", type=Path, default=Path("docs/corpus.md"))
    parser.add_argument("--clips", type=int, default=4, help="clips of each speaker (default: 4)")
    arguments = parser.parse_args(argv)
    if arguments.clips < 1:
        parser.error(f"--clips must be at least 1; found {arguments.clips}")
    try:
        write_report(arguments.data, arguments.real, arguments.out, arguments.clips)
    except (ReportError, CorpusError, OSError) as error:
        sys.stderr.write(f"{error}\n")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
