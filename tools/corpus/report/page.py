"""The words and tables of ``docs/corpus.md``."""

import numpy as np

from tools.corpus.report.realism import (
    Figures,
    MeasuredClip,
    judge_realism,
)

AIM, AIM_OVER_FLOOR = 0.85, 0.05
TOLD = 8  # figures of each table: those that tell most by themselves

Clips = list[MeasuredClip]


def report_page(clips: Clips, real: Clips, seed: int | None) -> str:
    """The whole page, of a corpus of that seed, where it is known; there may be no real clips."""
    names = [clip.clip_id for clip in real[:2]]
    bodies = [[clip.realism for clip in each] for each in (real, clips)]
    heads = [[clip.head_realism for clip in each] for each in (real, clips)]
    return "\n".join(
        [
            _HEAD,
            _about(clips, seed),
            _HOW,
            _realism("Can it be told from real motion?", names, *bodies),
            _realism("Can its head and jaw be told from real ones?", names, *heads),
            _OF_JAWS,
            _TAIL,
        ]
    )


def _table(head: list[str], rows: list[list[str]]) -> str:
    lines = ["| " + " | ".join(cells) + " |" for cells in (head, *rows)]
    lines.insert(1, "|---" * len(head) + "|")
    return "\n".join(lines) + "\n"


def _short(value: float) -> str:
    """Three significant digits without an exponent."""
    digits = 0 if value == 0 else max(0, 2 - int(np.floor(np.log10(abs(value)))))
    return f"{value:.{min(digits, 4)}f}"


def _about(clips: Clips, seed: int | None) -> str:
    of_seed = "" if seed is None else f" of seed {seed}"
    speakers = {clip.speaker for clip in clips}
    frames_s = sum(clip.duration_s for clip in clips)
    listening = sum(clip.listening_s for clip in clips) / frames_s
    return (
        f"{len(clips)} clips{of_seed} by {len(speakers)} speakers, who listen for {listening:.1%}"
        " of the time, which is left out.\n"
    )


def _realism(question: str, names: list[str], real: list[Figures], corpus: list[Figures]) -> str:
    title = f"## {question}\n\n"
    if len(real) < 2 or len(corpus) < 2:
        return f"{title}Too few clips to say.\n"
    realism = judge_realism(real, corpus)
    rows = []
    for told in realism.features.head(TOLD).reset_index(names="name").to_dict("records"):
        medians = [_short(told[which]) for which in ("first", "second", "corpus")]
        areas = [f"{told[which]:.2f}" for which in ("auc", "real_auc")]
        rows.append([told["name"], *medians, *areas, f"{told['share']:.0%}"])
    is_reached = realism.joint <= max(AIM, realism.floor + AIM_OVER_FLOOR)
    return (
        f"{title}Told from real with an area under the curve of **{realism.joint:.2f}**, by"
        f" {len(realism.features)} figures; real from real with {realism.floor:.2f}. The aim, at"
        f" most {AIM:g} or that + {AIM_OVER_FLOOR:g}, is {'reached' if is_reached else 'missed'}."
        "\n\n"
        + _table(
            ["figure", *names, "corpus", "by itself", "real against real", "share"],
            rows,
        )
    )


_HEAD = """# The procedural corpus in figures

All tables are made by `python -m tools.corpus.report --data CORPUS --real BEAT2`. How the corpus is
made is told in `tools/corpus/`, from `words` to `layout.py`. Real clips are one man's minutes from
BEAT2's test split. They guide tuning; nothing measured on them is a test result, and no frame of
them is in the corpus.
"""

_HOW = """## How it is told from real motion

A logistic regression over windows of 2 s is trained on one real clip and half of the corpus's clips
and tested on the others (mean of both ways; 0.5 is chance). Tables have the figures that tell most
by themselves: medians of windows, the area under the curve by the figure alone and of the two real
clips, and the figure's share in the regression's distance. Calm speakers differ from a lively man
also as people do.
"""

_OF_JAWS = """Recordings open the mouth by face units as well as by the jaw, the corpus by the jaw
above all: figures of the jaw tell two ways of writing a mouth down as much as two of moving it.
"""

_TAIL = """## Gestures

Every gesture at the end of its stroke.

![gestures](figures/corpus_gestures.png)

## Known faults

- Speech is flite's: clear, but flat. Accents are raised by level and pitch, more than people do.
- Speakers are calmer than the man of the real clips: wrists, elbows and feet are slower than his.
- Hands touch each other when folded, but no face and no thing. Nobody walks or turns away.
- Words call for some fifty literal gestures, always the same: "two" shows two fingers.
- Faces blink, speak, smile and raise brows; they show no feelings that the text has.
- While speakers listen nobody is heard: silence is digital zero, and nods answer nothing.
"""
