"""Command ``study analyse``: report on the answers of a study."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from app.errors import RunError
from app.run.output.result_folder import ResultFolder
from app.study.design.key import read_key

MAX_LISTED_ERRORS = 3
NO_KEY = (
    "Give the study's key with --key: it is key.json in the folder `researcher_only`. Without a "
    "key, only one .csv table of battles in the format of the GENEA leaderboard can be analysed."
)


@dataclass(frozen=True)
class AnalysisRequest:
    answers: Sequence[Path]
    """Answer files and folders of them; or one table of battles."""
    key: Path | None
    """Key of the study; None for a table of battles."""
    out: Path
    diagnostics: Path | None = None
    """Folder with CLIP/diagnostics.json of each clip, to compare the answers with its jerk."""


def analyse(request: AnalysisRequest, *_: object) -> tuple[Path, ...]:
    """Write the report and its tables and figure; return their paths, the report first.

    The files are ``report.html``, ``results.csv``, ``participants.csv``, ``table.tex``,
    ``preference.pdf`` and, of choices, ``battles.csv``. Raises RunError if the key cannot be used,
    or no participant is left to analyse.
    """
    from app.study.report.figures import result_bars, write_pdf
    from app.study.report.report import latex_table, participants_csv, render_report, results_csv
    from app.study.statistics.answers import CollectedAnswers, collect_answers
    from app.study.statistics.results import analyse_participants, measure_answer_balance, read_jerk
    from app.study.statistics.screening import ScreeningResult, screen
    from app.study.statistics.votes import battles_of, read_battles
    from model.storage.escaping import csv_text

    if request.key is not None:
        key = read_key(request.key)
        collected = collect_answers(request.answers, key)
        screened = screen(collected.participants, key)
    elif [path.suffix for path in request.answers] == [".csv"]:
        key, raters = read_battles(request.answers[0])
        note = (
            f"{key.title} is a table of battles without attention checks or response times, so no "
            "participants could be excluded."
        )
        collected = CollectedAnswers(tuple(raters), (note,))
        screened = ScreeningResult(tuple(raters))
    else:
        raise RunError(NO_KEY)
    jerk_by_video = read_jerk(request.diagnostics, key) if request.diagnostics else None
    results = analyse_participants(screened.included, key, jerk_by_video)
    if not results:
        left = (*screened.excluded, *screened.implausible)
        sentences = [f"{one.participant.file_name}: {one.reason}." for one in left]
        reasons = [*collected.left_out_sentences, *sentences][:MAX_LISTED_ERRORS]
        raise RunError(" ".join(["There are no valid answers to analyse.", *reasons]))
    balance = measure_answer_balance(screened.included, key)
    everyone = [*screened.included, *(one.participant for one in screened.implausible)]
    with_all = analyse_participants(everyone, key) if screened.implausible else []
    page = render_report(key, collected, screened, balance, results, with_all)
    battles = battles_of(screened.included, key)
    with ResultFolder(request.out) as folder:
        folder.new_path("report.html").write_text(page, "utf-8", errors="replace")  # for file names
        if len(battles):
            rows = [list(battles), *battles.to_numpy().tolist()]
            folder.new_path("battles.csv").write_text(csv_text(rows, "\n"), "utf-8", newline="")
        write_pdf(result_bars(results, key), folder.new_path("preference.pdf"))
        folder.new_path("results.csv").write_text(results_csv(results), "utf-8", newline="")
        people = participants_csv(key, screened)
        folder.new_path("participants.csv").write_text(people, "utf-8", "replace", newline="")
        folder.new_path("table.tex").write_text(latex_table(results, key), "utf-8")
        return folder.publish()
