"""The motion, speech and annotation in ``examples/procedural_speaker``: whole sentences out of one
clip of the corpus. ``python -m tests.tools.corpus.made_example`` makes the files anew."""

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

from conventions.rates import FPS, SAMPLE_RATE
from tools.corpus.build import make_clip_of_job, plan_jobs
from tools.corpus.clip import ClipPaths, CorpusClip, clip_paths, write_clip

EXAMPLE = Path(__file__).resolve().parents[3] / "examples" / "procedural_speaker"
NAME = "a_procedural_speaker"
HOURS, SEED, INDEX = 5.0, 1, 290
START_S, LENGTH_S = 38.1, 14.0
"""Of the part; both are whole frames and whole samples."""


def made_example(root: Path) -> ClipPaths:
    """The example's three files, made anew under ``root`` as a corpus has them.

    Raises:
        VoiceError: where flite is missing or fails.
    """
    job = plan_jobs(root, HOURS, SEED)[INDEX]
    write_clip(root, NAME, part_of(make_clip_of_job(job), START_S, LENGTH_S))
    return clip_paths(root, NAME)


def part_of(clip: CorpusClip, start_s: float, length_s: float) -> CorpusClip:
    """The clip from ``start_s`` on, for ``length_s`` seconds; events keep what lies outside of it,
    which the annotation cuts."""

    def later(one: Any, *names: str) -> Any:
        return replace(one, **{name: getattr(one, name) - start_s for name in names})

    def spans(events: tuple[Any, ...]) -> tuple[Any, ...]:
        return tuple(later(one, "start_s", "end_s") for one in events)

    def moments(events: tuple[Any, ...]) -> tuple[Any, ...]:
        return tuple(later(one, "time_s") for one in events)

    frames, samples = (
        slice(round(start_s * rate), round((start_s + length_s) * rate))
        for rate in (FPS, SAMPLE_RATE)
    )
    said, face, legs = clip.utterance, clip.face, clip.legs
    return CorpusClip(
        poses=clip.poses[frames],
        trans=clip.trans[frames],
        expressions=clip.expressions[frames],
        utterance=replace(
            said,
            waveform=said.waveform[samples],
            phones=spans(said.phones),
            words=tuple(later(word, "start_s", "end_s", "beat_s") for word in said.words),
            phrases=spans(said.phrases),
            listening=spans(said.listening),
        ),
        plan=replace(
            clip.plan,
            keys={
                side: [later(key, "arrive_s") for key in keys]
                for side, keys in clip.plan.keys.items()
            },
            cycles=[later(cycle, "start_s", "end_s") for cycle in clip.plan.cycles],
            shrugs=[(a - start_s, b - start_s) for a, b in clip.plan.shrugs],
        ),
        trunk=replace(clip.trunk, nods=moments(clip.trunk.nods), gaze=spans(clip.trunk.gaze)),
        face=replace(
            face,
            brows=moments(face.brows),
            smiles=spans(face.smiles),
            blinks=moments(face.blinks),
        ),
        legs=replace(legs, stances=spans(legs.stances), planted=spans(legs.planted)),
    )


def main() -> None:
    """Put newly made files in the example's folder."""
    with tempfile.TemporaryDirectory() as folder:
        made = made_example(Path(folder))
        for path in (made.motion, made.sound, made.textgrid):
            (EXAMPLE / path.name).write_bytes(path.read_bytes())


if __name__ == "__main__":
    main()
