"""Commands of a blind user study, from a plan (TOML) to a web page and a report."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from app.config import BUNDLED_WEIGHTS, default_body
from app.errors import RunError
from app.flags import Count, File, FileOrDefault, text_type
from app.run.output.console import ProgressBars, print_message, print_path

Study = Annotated[Positional[Path], arg(metavar="DIR", help="Folder that the export made.")]


def export(
    plan: Annotated[Positional[Path], arg(metavar="PLAN.toml")],
    out: Path,
    body: FileOrDefault = None,
    weights: Path = BUNDLED_WEIGHTS,
) -> None:
    """Create the participants' web page and the researcher's folder.

    All videos are rendered under random names. Run the same command again to continue after an
    interruption; the key is reused.

    Args:
        plan: Study plan, a TOML file (docs/user-study.md).
        out: Folder of the study.
        body: A character (.vrm, .glb) or licensed SMPLX_NEUTRAL*.npz; by default $SMPLX_MODEL, else
            the open body.
        weights: Folder of trained systems.
    """
    from app.run.callbacks import RunCallbacks
    from app.study.design.plan import read_plan
    from app.study.export import export_study

    body = body or default_body()
    read = read_plan(plan.absolute())
    try:
        with ProgressBars() as shown:
            workspace = export_study(read, out, weights, body, RunCallbacks(shown.on_event))
    except KeyboardInterrupt:
        raise RunError(
            "Interrupted. The key and the finished videos are kept; run the same command again to "
            "continue."
        ) from None
    print_message(
        f"Study of {len(read.clips)} clips and {len(read.systems)} systems with "
        f"{read.participants} lists; no leak was found. Host the first of these folders; keep the "
        "second one private."
    )
    print_path(workspace.bundle)
    print_path(workspace.private)


def check(study: Study) -> None:
    """Check an export for anything that reveals the system behind a video.

    Names, addresses, JSON, metadata, times, order, sizes, bit rates, lengths and sound are tested
    against the system. The exit status is 1 if something reveals it.
    """
    from app.study.leaks import check_study

    leaks = check_study(study)
    for leak in leaks:
        print_message(f"LEAK {leak}")
    if leaks:
        summary = "1 leak was found" if len(leaks) == 1 else f"{len(leaks)} leaks were found"
        raise RunError(f"{summary}; do not host this bundle.")
    sys.stdout.write("No leak was found.\n")


def links(
    study: Study,
    address: str,
    participants: Annotated[Count, arg(help_behavior_hint="")] = None,
) -> None:
    """Write a signed link for each participant.

    Participant, list and link are written as CSV. From then on, the analysis excludes answers that
    came without a link, with a forged one, or with one used twice. The same links are written each
    time.

    Args:
        address: URL at which participant_bundle is hosted.
        participants: Number of links; by default as many as the study plan has participants.
    """
    import secrets
    from dataclasses import replace

    from app.study.design.key import MAX_LINKS, read_key, write_key
    from model.storage.escaping import csv_text

    path = study / "researcher_only" / "key.json"
    key = read_key(path)
    count = key.participants if participants is None else participants
    if not 1 <= count <= MAX_LINKS:
        raise RunError(f"--participants must be from 1 to {MAX_LINKS}; got {count}.")
    is_new = key.link_secret is None
    key = replace(key, link_secret=key.link_secret or secrets.token_hex(32))
    rows = [(n, key.list_of(n), key.link(n, address)) for n in range(count)]
    if is_new:
        write_key(key, path)
    sys.stdout.write(csv_text([("participant", "list", "link"), *rows]))


def analyse(
    answers: Annotated[
        Positional[tuple[Path, ...]], arg(metavar="ANSWERS", help_behavior_hint="(required)")
    ],
    out: Path,
    key: File = None,
    diagnostics: File = None,
) -> None:
    """Analyse answers and write a report (HTML, CSV, LaTeX).

    Participants who failed more attention checks than the study plan's max_failed are excluded.
    The report has preference shares, tests, Bradley-Terry strengths and the power of the design.

    Args:
        answers: Answer files, or folders of them.
        key: researcher_only/key.json; without it, the answers are one table of battles (CSV) in the
            format of the GENEA leaderboard's analysis.
        out: Folder of results.
        diagnostics: Folder with CLIP/diagnostics.json for each clip; their jitter is compared with
            the reasons that participants gave.
    """
    from app.study.analyse import AnalysisRequest
    from app.study.analyse import analyse as analysed

    analysed(AnalysisRequest(list(answers), key, out, diagnostics))


def _strengths(flag: str) -> dict[str, float]:
    strengths = {}
    for part in flag.split(","):
        name, separator, number = part.rpartition("=")
        try:
            strengths[name.strip()] = float(number)
        except ValueError:
            separator = ""
        if not separator or not name.strip():
            raise RunError(f"{part!r} is not of the form NAME=NUMBER")
    return strengths


def simulate(
    study: Study,
    raters: int,
    strengths: Annotated[dict[str, float], text_type(_strengths, "NAME=V,...")],
    out: Path,
    seed: int = 0,
) -> None:
    """Simulate the answers of raters with known preferences.

    This tests the analysis before there are answers: the raters follow a Bradley-Terry model with
    the strengths from --strengths (natural logarithm).

    Args:
        raters: Number of simulated raters.
        strengths: Strength of every system of the study plan, such as recorded=1,ours=0.
        out: Folder for the answers.
        seed: Seed of the answers.
    """
    from app.study.simulate import simulate as simulated

    simulated(study, raters, strengths, seed, out)
