"""Command ``python -m tools.corpus.report --data DIR [--real DIR] [--out FILE]``: corpus report.

Writes a Markdown page with statistics of the corpus and of real clips, how well a classifier
distinguishes them, and a picture of all gestures.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
from jaxtyping import Float
from PIL import Image
from tqdm import tqdm

from conventions.joints import NUM_JOINTS
from model.storage.files import write_atomically
from model.storage.npz import MotionError
from renderer.body.body import BodyMotion, load_body
from renderer.video.compose import draw_label_band
from renderer.video.render import RenderSettings, draw_frames
from tools.command import run_cli
from tools.corpus.body.arms import follow_plan, move_arms
from tools.corpus.body.contact import hips_in_chest
from tools.corpus.body.trunk import PELVIS_TILT_DEG, SPINE
from tools.corpus.build import MANIFEST, CorpusError, read_manifest
from tools.corpus.clip import MOTION, SPLIT_TABLE, ClipPaths, clip_paths
from tools.corpus.gesture.gestures import GESTURES, REST, HandPose
from tools.corpus.gesture.plan import HandKey, HandPlan
from tools.corpus.people.rig import Rig, axis_angles, euler_matrices, open_body_rig
from tools.corpus.people.speaker import SPEAKERS
from tools.corpus.report.realism import Figures, MeasuredClip, measure_clip, measure_separability

COLUMNS, SIZE_PX = 8, 144
VIEW = "three_quarter"


def draw_gestures(rig: Rig, path: Path) -> None:
    """Draw a contact sheet of all gestures' stroke ends and rest poses; may raise GLError."""
    poses = {name: (gesture.stroke, gesture.hands) for name, gesture in GESTURES.items()}
    poses |= {f"rest: {name}": (pose, "two") for name, pose in REST.items()}
    held = [_held(rig, pose, both=hands in ("two", "free")) for pose, hands in poses.values()]
    motion = replace(BodyMotion.zero_pose(len(held)), poses=np.stack(held))
    settings = RenderSettings(SIZE_PX, SIZE_PX, VIEW, framing="knees")
    pictures = [picture.copy() for picture in draw_frames(load_body(), motion, settings)]
    names = [name.replace("_", " ") for name in poses]
    missing = -len(pictures) % COLUMNS
    pictures += [np.full_like(pictures[0], 255)] * missing
    names += [""] * missing
    rows = []
    for start in range(0, len(pictures), COLUMNS):
        row = slice(start, start + COLUMNS)
        rows += [draw_label_band(names[row], SIZE_PX, 2 * SIZE_PX), np.hstack(pictures[row])]
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.vstack(rows)).quantize(256).save(path, optimize=True)


def _held(rig: Rig, pose: HandPose, both: bool) -> Float[np.ndarray, " 165"]:
    """Return the pose (rad) of a standing body with one or both hands in a pose."""
    other = pose if both else REST["hang"]
    keys = {
        "right": [HandKey(-1.0, 0.5, pose, "stroke", "")],
        "left": [HandKey(-1.0, 0.5, other, "stroke", "")],
    }
    rng, num_frames = np.random.default_rng(0), 31
    speaking = np.zeros(num_frames)
    posture = ((0, PELVIS_TILT_DEG), *((joint, bend) for joint, _, bend in SPINE))
    trunk = {j: euler_matrices("X", np.full((num_frames, 1), pitch)) for j, pitch in posture}
    curves = follow_plan(rig, HandPlan(keys), speaking, SPEAKERS[0], rng)
    arms = move_arms(
        rig, HandPlan(keys), curves, hips_in_chest(rig, trunk), speaking, SPEAKERS[0], rng
    )
    vectors = np.zeros((NUM_JOINTS, 3))
    for joint, rotmat in (trunk | arms).items():
        vectors[joint] = axis_angles(rotmat[num_frames // 2])
    return vectors.ravel()


AIM, AIM_OVER_FLOOR = 0.85, 0.05
NUM_TABLE_FEATURES = 8  # rows of each table: the statistics that separate best alone

Clips = list[MeasuredClip]


def report_page(clips: Clips, real: Clips, seed: int | None) -> str:
    """Format the page; the seed may be unknown, and there may be no real clips."""
    names = [clip.clip_id for clip in real[:2]]
    bodies = [[clip.realism for clip in each] for each in (real, clips)]
    heads = [[clip.head_realism for clip in each] for each in (real, clips)]
    return "\n".join(
        [
            _HEAD,
            _about(clips, seed),
            _HOW,
            _realism("Can a classifier tell it from real motion?", names, *bodies),
            _realism("Can a classifier tell its head and jaw from real ones?", names, *heads),
            _OF_JAWS,
            _TAIL,
        ]
    )


def _table(head: list[str], rows: list[list[str]]) -> str:
    lines = ["| " + " | ".join(cells) + " |" for cells in (head, *rows)]
    lines.insert(1, "|---" * len(head) + "|")
    return "\n".join(lines) + "\n"


def _short(value: float) -> str:
    """Format a number with three significant digits, without exponent."""
    digits = 0 if value == 0 else max(0, 2 - int(np.floor(np.log10(abs(value)))))
    return f"{value:.{min(digits, 4)}f}"


def _about(clips: Clips, seed: int | None) -> str:
    of_seed = "" if seed is None else f" of seed {seed}"
    speakers = {clip.speaker for clip in clips}
    frames_s = sum(clip.duration_s for clip in clips)
    listening = sum(clip.listening_s for clip in clips) / frames_s
    return (
        f"{len(clips)} clips{of_seed} by {len(speakers)} speakers. Passages in which they listen"
        f" ({listening:.1%} of the time) are left out.\n"
    )


def _realism(question: str, names: list[str], real: list[Figures], corpus: list[Figures]) -> str:
    title = f"## {question}\n\n"
    if len(real) < 2 or len(corpus) < 2:
        return f"{title}There are too few clips for a classifier.\n"
    realism = measure_separability(real, corpus)
    rows = []
    for row in (
        realism.features.head(NUM_TABLE_FEATURES).reset_index(names="name").to_dict("records")
    ):
        medians = [_short(row[which]) for which in ("first", "second", "corpus")]
        areas = [f"{row[which]:.2f}" for which in ("auc", "real_auc")]
        rows.append([row["name"], *medians, *areas, f"{row['share']:.0%}"])
    is_reached = realism.joint <= max(AIM, realism.floor + AIM_OVER_FLOOR)
    return (
        f"{title}A classifier with {len(realism.features)} features separates it from real motion"
        f" with an area under the curve of **{realism.joint:.2f}**, and the two real clips from"
        f" each other with {realism.floor:.2f}. The target (at most {AIM:g}, or at most"
        f" {AIM_OVER_FLOOR:g} above the latter) is {'reached' if is_reached else 'missed'}."
        "\n\n" + _table(["figure", *names, "corpus", "alone", "real against real", "share"], rows)
    )


_HEAD = """# Statistics of the procedural corpus

How close the procedural corpus is to recorded motion. `tools/corpus/` generates the corpus, from
`words` to `clip.py`; `python -m tools.corpus.report --data CORPUS --real BEAT2` makes all tables.
Real clips are a few minutes of one man from BEAT2's test split. They guide tuning, so nothing
measured on them is a test result; no frame of them is in the corpus.
"""

_HOW = """## Method: comparison with real motion

A logistic regression over windows of 2 s is trained on one real clip and half of the corpus's clips
and tested on the others (mean of both splits; chance level 0.5). Tables list the most informative
features: medians over windows, the area under the curve (AUC) of the feature alone and between the
two real clips, and the feature's share in the regression's distance. Part of the difference is that
between people: calm speakers and a lively man.
"""

_OF_JAWS = """Recordings open the mouth by blendshapes as well as by the jaw, the corpus
mainly by the jaw, so features of the jaw show a difference of representation as much as one of
movement.
"""

_TAIL = """## Gestures

Every gesture form at the end of its stroke.

![gestures](figures/corpus_gestures.png)

## Known limitations

- Speech is from flite: clear, but flat. Accents are raised in level and pitch, more than by people.
- Speakers are calmer than the man of the real clips: wrists, elbows and feet are slower than his.
- Folded hands touch each other, but hands touch no face and no object. Nobody walks or turns away.
- Words trigger some fifty literal gestures, always the same: "two" shows two fingers.
- Faces blink, speak, smile and raise brows, but do not express the emotions of the text.
- While speakers listen, there is no other voice: silence is digital zero, and nods answer nothing.
"""


class ReportError(ValueError):
    """Error for a report that cannot be made."""


def write_report(
    data: Path, real: Path | None = None, out: Path = Path("docs/corpus.md"), clips: int = 8
) -> None:
    """Describe a corpus in statistics, on a page with a picture of its gestures.

    Args:
        data: Corpus folder.
        real: Folder of real BEAT2 clips to compare with.
        out: Path of the page.
        clips: Largest number of clips of each speaker, and of real clips.
    """
    rig = open_body_rig()
    by_speaker: dict[str, list[str]] = {}
    all_clips = list_clips(data)
    for clip_id in all_clips:
        by_speaker.setdefault(clip_id.split("_")[1], []).append(clip_id)
    chosen = {each: all_clips[each] for ids in by_speaker.values() for each in ids[:clips]}
    real_clips: list[MeasuredClip] = []
    if real is not None:
        first = dict(list(list_clips(real).items())[:clips])
        real_clips = measure_clips(first, rig, "Measuring real clips")
    measured = measure_clips(chosen, rig, "Measuring the corpus")
    manifest = data / MANIFEST
    seed = int(read_manifest(manifest)["seed"]) if manifest.is_file() else None
    draw_gestures(rig, out.parent / "figures" / "corpus_gestures.png")
    write_atomically(out, report_page(measured, real_clips, seed))


def list_clips(root: Path) -> dict[str, ClipPaths]:
    """Return the paths of clips with motion, by id; raises ReportError if there are none."""
    table = root / SPLIT_TABLE
    ids = pd.read_csv(table, dtype=str)["id"] if table.is_file() else ()
    clips = {each: clip_paths(root, each) for each in ids}
    there = {each: paths for each, paths in clips.items() if paths.motion.is_file()}
    if not there:
        raise ReportError(f"{root} holds no clips in BEAT2's layout ({MOTION}, {SPLIT_TABLE}).")
    return there


def measure_clips(clips: dict[str, ClipPaths], rig: Rig, title: str) -> list[MeasuredClip]:
    shown = tqdm(clips.items(), unit="clip", desc=title)
    return [measure_clip(clip_id, paths, rig) for clip_id, paths in shown]


def main(arguments: list[str] | None = None) -> int:
    program = "tools.corpus.report"
    return run_cli(write_report, program, arguments, MotionError, ReportError, CorpusError, OSError)


if __name__ == "__main__":
    sys.exit(main())
