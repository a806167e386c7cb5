"""The command ``hearing``: what of a system's motion its speech decides, and what chance."""

from __future__ import annotations

import argparse
from pathlib import Path

from app.commands.said import name_file, say
from app.config import BUNDLED_WEIGHTS
from app.errors import RunError
from app.family_files import add_family_files, use_family_files
from app.run.hearing import HearingRequest, measure_hearing
from model.systems.registry import usual_systems


def add_hearing(commands) -> None:
    """The command with its flags."""
    parser = commands.add_parser(
        "hearing",
        help="does it hear? what speech decides of the motion, and what chance",
        description="Generate each speech with each noise seed and compare: motions that share the "
        "speech, the noise, or neither. Or compare a folder of anyone's motion, whose files are "
        "called SYSTEM__SPEECH__SEED.npz.",
    )
    parser.add_argument(
        "given", type=Path, nargs="+", metavar="SPEECH",
        help="two sound files or more, or one folder of motions",
    )  # fmt: skip
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument(
        "--systems",
        default=",".join(usual_systems("hearing")),
        metavar="A,B,...",
        help="default: %(default)s",
    )
    parser.add_argument("--seeds", type=int, default=2, metavar="N", help="default: %(default)s")
    parser.add_argument("--speaker", metavar="NAME", help="whose manner (default: the first)")
    parser.add_argument(
        "--speakers", metavar="CALM,LIVELY",
        help="two speakers whose manner is compared on the first speech, such as hana,june",
    )  # fmt: skip
    parser.add_argument(
        "--videos", action="store_true",
        help="draw the bodies of the first two speeches and seeds, under the sound of either",
    )  # fmt: skip
    parser.add_argument(
        "--guidance", type=float, metavar="N",
        help="strength of the speech; 1 is as trained (default: as suits each system)",
    )  # fmt: skip
    parser.add_argument("--weights", type=Path, default=BUNDLED_WEIGHTS, metavar="DIR")
    add_family_files(parser)
    parser.set_defaults(command=_hearing)


def _two(speakers: str | None) -> tuple[str, str] | None:
    if speakers is None:
        return None
    calm, comma, lively = speakers.partition(",")
    if not (calm and comma and lively) or calm == lively:
        raise RunError(f"--speakers takes two names, CALM,LIVELY; got {speakers!r}.")
    return calm, lively


def _hearing(options: argparse.Namespace) -> None:
    from app.commands.terminal import ProgressBar

    use_family_files(options)
    is_folder = len(options.given) == 1 and options.given[0].is_dir()
    systems = tuple(name for name in options.systems.split(",") if name)
    request = HearingRequest(
        out=options.out,
        speeches=() if is_folder else tuple(options.given),
        systems=() if is_folder else systems,
        motions=options.given[0] if is_folder else None,
        seeds=options.seeds,
        speaker=options.speaker,
        speakers=_two(options.speakers),
        has_videos=options.videos,
        guidance=options.guidance,
        weights=options.weights,
    )
    with ProgressBar("compare") as bar:
        hearing = measure_hearing(request, bar.show)
    for sentence in hearing.sentences():
        say(sentence)
    for path in hearing.files:
        name_file(path)
