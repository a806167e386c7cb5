"""Commands of a blind user study, from a plan (TOML) to a web page and a report."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from app.config import BUNDLED_WEIGHTS, body_from_environment
from app.errors import RunError
from app.flags import Count, File, FileOrDefault, parsed_type
from app.run.output.console import ProgressBars, print_message, print_path
from conventions.names import pluralise

StudyFolder = Annotated[
    Positional[Path], arg(metavar="DIR", help="Folder written by `study export`.")
]


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
            the bundled body.
        weights: Folder of trained systems.
    """
    from app.run.callbacks import RunCallbacks
    from app.study.design.plan import read_study_plan
    from app.study.export import export_study

    body = body or body_from_environment()
    read = read_study_plan(plan.absolute())
    try:
        with ProgressBars() as shown:
            folders = export_study(read, out, weights, body, RunCallbacks(shown.on_event))
    except KeyboardInterrupt:
        raise RunError(
            "Interrupted. The key and the finished videos are kept; run the same command again to "
            "continue."
        ) from None
    print_message(
        f"The study has {pluralise(len(read.clips), 'clip')}, "
        f"{pluralise(len(read.conditions), 'system')} and "
        f"{pluralise(read.participants, 'trial list')} (one per participant); no leak of system "
        f"identities was found. Host {folders.bundle.name}; keep {folders.private.name} private."
    )
    print_path(folders.bundle)
    print_path(folders.private)


def check_leaks(study: StudyFolder) -> None:
    """Check an export for anything that reveals the system behind a video.

    Names, addresses, JSON, metadata, times, order, sizes, bit rates, lengths and sound are tested
    for any relation to the system. The exit status is 1 if a leak is found.
    """
    from app.study.leaks import find_leaks

    leaks = find_leaks(study)
    for leak in leaks:
        print_message(f"LEAK {leak}")
    if leaks:
        summary = "1 leak was found" if len(leaks) == 1 else f"{len(leaks)} leaks were found"
        raise RunError(f"{summary}; do not host this bundle.")
    sys.stdout.write("No leak was found.\n")


def create_links(
    study: StudyFolder,
    address: str,
    participants: Annotated[Count, arg(help_behavior_hint="")] = None,
) -> None:
    """Create a signed link for each participant.

    Participant, list and link are written to standard output as CSV; running the command again
    writes the same links. The signing secret is stored in key.json. From then on, the analysis
    excludes answers without a link, with a forged link, or with a link that was used twice.

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
    count = key.num_participants_planned if participants is None else participants
    if not 1 <= count <= MAX_LINKS:
        raise RunError(f"--participants must be from 1 to {MAX_LINKS}; got {count}.")
    is_new = key.link_secret is None
    key = replace(key, link_secret=key.link_secret or secrets.token_hex(32))
    rows = [(n, key.list_number_of(n), key.link(n, address)) for n in range(count)]
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
        key: researcher_only/key.json; without it, the answers must be one table of battles
            (CSV) in the format of the GENEA leaderboard's analysis.
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
    study: StudyFolder,
    raters: int,
    strengths: Annotated[dict[str, float], parsed_type(_strengths, "NAME=V,...")],
    out: Path,
    seed: int = 0,
) -> None:
    """Simulate the answers of raters with known preferences.

    This tests the analysis before there are answers: the raters follow a Bradley-Terry model with
    the log-strengths from --strengths (natural logarithm).

    Args:
        raters: Number of simulated raters.
        strengths: Log-strength of every system of the study plan, such as recorded=1,ours=0.
        out: Folder for the answers.
        seed: Seed of the answers.
    """
    from app.study.simulate import simulate as simulated

    simulated(study, raters, strengths, seed, out)
