"""``python -m app study``: export, check, links, analyse, simulate."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from app.commands.many import add_pool, pool_of
from app.commands.said import name_file, say
from app.config import BUNDLED_WEIGHTS, default_body
from app.errors import RunError


def add_study(commands) -> None:
    """Add the command and its parts."""
    parser = commands.add_parser(
        "study",
        help="blind user study: export videos and page, test for leaks, analyse answers",
        description="From a plan (TOML) to a blind study that any web host can serve, and from "
        "its answers to a report.",
    )
    parts = parser.add_subparsers(title="parts", required=True, metavar="PART")
    _add_export(parts)
    _add_check(parts)
    _add_links(parts)
    _add_analyse(parts)
    _add_simulate(parts)


def _add_export(parts) -> None:
    parser = parts.add_parser(
        "export",
        help="make the bundle for participants and the researcher's folder",
        description="Draw all videos under random names and make the page. Started again after an "
        "interruption, it keeps its key and goes on.",
    )
    parser.add_argument("plan", type=Path, metavar="PLAN.toml")
    parser.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="folder of the study"
    )
    parser.add_argument(
        "--body",
        type=Path,
        default=default_body(),
        metavar="FILE",
        help="licensed SMPLX_NEUTRAL*.npz (default: $SMPLX_MODEL, else the open body)",
    )
    parser.add_argument(
        "--weights", type=Path, default=BUNDLED_WEIGHTS, metavar="DIR", help="default: bundled"
    )
    parser.add_argument(
        "--workers", type=int, default=2, metavar="N", help="videos drawn at once (default: 2)"
    )
    add_pool(parser)
    parser.set_defaults(command=_export)


def _export(options: argparse.Namespace) -> None:
    from app.commands.said import ProgressBar
    from app.study.design.plan import read_plan
    from app.study.export import export_study
    from app.study.make.workspace import ExportOptions

    if options.workers < 1:
        raise RunError(f"--workers must be at least 1; got {options.workers}.")
    plan = read_plan(options.plan.absolute())
    is_shared = options.processes is not None or options.scheduler is not None
    try:
        with ProgressBar("draw the videos") as bar:
            workspace = export_study(
                plan,
                options.out,
                ExportOptions(
                    options.weights.absolute(),
                    options.body and options.body.absolute(),
                    options.workers,
                    pool_of(options) if is_shared else None,
                ),
                on_progress=bar.show,
            )
    except KeyboardInterrupt:
        raise RunError(
            "stopped; the key and the finished videos are kept, so the same command goes on."
        ) from None
    say(
        f"{len(plan.clips)} clips, {len(plan.systems)} systems, {plan.participants} lists; no leak "
        "was found. Host the first folder; keep the second one to yourself."
    )
    name_file(workspace.bundle)
    name_file(workspace.private)


def _add_check(parts) -> None:
    parser = parts.add_parser(
        "check",
        help="test an export for anything that tells the method",
        description="Names, addresses, JSON, metadata, times, order, sizes, bit rates, lengths and "
        "sound against the method. Exit status 1 when something leaks.",
    )
    parser.add_argument("study", type=Path, metavar="DIR", help="folder that the export made")
    parser.set_defaults(command=_check)


def _check(options: argparse.Namespace) -> None:
    from app.study.leaks import check_study

    leaks = check_study(options.study)
    for leak in leaks:
        say(f"LEAK {leak}")
    if leaks:
        found = "1 leak was found" if len(leaks) == 1 else f"{len(leaks)} leaks were found"
        raise RunError(f"{found}; do not host this bundle.")
    sys.stdout.write("No leak was found.\n")


def _add_links(parts) -> None:
    parser = parts.add_parser(
        "links",
        help="signed links for participants, each good for once",
        description="Write participant, list and link of each as CSV. From then on the analysis "
        "sets answers aside that came by no link, a forged one, or one that was used twice. "
        "Called again, it gives the same links.",
    )
    parser.add_argument("study", type=Path, metavar="DIR", help="folder that the export made")
    parser.add_argument(
        "--address", required=True, metavar="URL", help="where participant_bundle is hosted"
    )
    parser.add_argument(
        "--participants", type=int, metavar="N", help="default: as many as are planned"
    )
    parser.set_defaults(command=_links)


def _links(options: argparse.Namespace) -> None:
    from dataclasses import replace

    from app.study.design.key import read_key, write_key
    from app.study.design.links import MAX_LINKS, link_of, list_of, new_secret
    from model.storage.harmless import csv_text

    path = options.study / "researcher_only" / "key.json"
    key = read_key(path)
    count = key.participants if options.participants is None else options.participants
    if not 1 <= count <= MAX_LINKS:
        raise RunError(f"--participants must be 1 to {MAX_LINKS}; got {count}.")
    is_new = key.link_secret is None
    key = replace(key, link_secret=key.link_secret or new_secret())
    rows = [(n, list_of(key, n), link_of(key, n, options.address)) for n in range(count)]
    if is_new:
        write_key(key, path)
    sys.stdout.write(csv_text([("participant", "list", "link"), *rows]))


def _add_analyse(parts) -> None:
    parser = parts.add_parser(
        "analyse",
        help="answers to a report (HTML, CSV, LaTeX)",
        description="Read answers, leave out who failed the attention checks, and report shares, "
        "tests, strengths and the power of the design.",
    )
    parser.add_argument(
        "answers", type=Path, nargs="+", metavar="ANSWERS", help="files, or folders of them"
    )
    parser.add_argument("--key", type=Path, required=True, help="researcher_only/key.json")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of results")
    parser.add_argument(
        "--diagnostics",
        type=Path,
        metavar="DIR",
        help="folder with CLIP/diagnostics.json or CLIP.json for each clip, whose jitter is held "
        "against the reasons people gave",
    )
    parser.set_defaults(command=_analyse)


def _analyse(options: argparse.Namespace) -> None:
    from app.study.analyse import AnalysisRequest, analyse

    analyse(AnalysisRequest(options.answers, options.key, options.out, options.diagnostics))


def _add_simulate(parts) -> None:
    parser = parts.add_parser(
        "simulate",
        help="answers of made-up raters with known preferences",
        description="Try the analysis before anyone has answered: raters who follow a "
        "Bradley-Terry model with the strengths given (natural logarithm).",
    )
    parser.add_argument("study", type=Path, metavar="DIR", help="folder that the export made")
    parser.add_argument("--raters", type=int, required=True, metavar="N")
    parser.add_argument(
        "--strengths", type=_strengths, required=True, metavar="NAME=V,...", help="by system"
    )
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="default: %(default)s")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder of answers")
    parser.set_defaults(command=_simulate)


def _simulate(options: argparse.Namespace) -> None:
    from app.study.simulate import simulate

    simulate(options.study, options.raters, options.strengths, options.seed, options.out)


def _strengths(value: str) -> dict[str, float]:
    strengths = {}
    for part in value.split(","):
        name, separator, number = part.rpartition("=")
        try:
            strengths[name.strip()] = float(number)
        except ValueError:
            separator = ""
        if not separator or not name.strip():
            raise argparse.ArgumentTypeError(f"{part!r} is not NAME=NUMBER")
    return strengths
