"""``study analyse``: answers in, report out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from app.errors import RunError
from app.run.output.result_folder import held_folder
from app.run.requests.request import OnEvent, ShouldCancel
from app.study.design.key import read_key
from model.storage.files import written_atomically

MAX_REASONS_SHOWN = 3


@dataclass(frozen=True)
class AnalysisRequest:
    """What is to be analysed."""

    answers: Sequence[Path]
    """Files, and folders of them."""
    key: Path
    out: Path
    diagnostics: Path | None = None
    """Folder of measured clips (see `app.study.statistics.jitter_join.read_jitter`)."""


def analyse(
    request: AnalysisRequest,
    on_event: OnEvent = lambda event: None,
    should_cancel: ShouldCancel = lambda: False,
) -> tuple[Path, ...]:
    """Write ``report.html``, ``results.csv``, ``table.tex`` and ``preference.pdf``, the report
    first of those returned.

    Raises:
        RunError: if the key cannot be used, or nobody is left to analyse.
    """
    from app.study.report.figures import preference_bars, write_pdf
    from app.study.report.html import Findings, page_of
    from app.study.report.tables import latex_table, write_csv
    from app.study.statistics.answers import collect
    from app.study.statistics.jitter_join import read_jitter
    from app.study.statistics.results import analyse_participants, balance_reached
    from app.study.statistics.screening import screen
    from app.study.statistics.votes import clips_of

    key, out, diagnostics = read_key(request.key), request.out, request.diagnostics
    jitter = read_jitter(diagnostics, clips_of(key), key.systems) if diagnostics else None
    collected = collect(list(request.answers), key)
    screened = screen(collected.participants, key)
    results = analyse_participants(screened.kept, key, jitter)
    if not results:
        left = (*screened.dropped, *screened.set_aside)
        dropped = [f"{one.participant.source}: {one.why}." for one in left]
        reasons = [*collected.left_out, *dropped][:MAX_REASONS_SHOWN]
        raise RunError(" ".join(["No answers are left to analyse.", *reasons]))
    balance = balance_reached(screened.kept, key)
    everyone = [*screened.kept, *(one.participant for one in screened.set_aside)]
    with_all = analyse_participants(everyone, key) if screened.set_aside else []
    findings = Findings(key, collected, screened, balance, results, with_all)
    with held_folder(out):
        with written_atomically(out / "results.csv") as part:
            write_csv(results, key, part)
        with written_atomically(out / "table.tex") as part:
            part.write_text(latex_table(results, key), "utf-8")
        with written_atomically(out / "preference.pdf") as part:
            write_pdf(preference_bars(results, key), part)
        with written_atomically(out / "report.html") as part:
            part.write_text(page_of(findings), "utf-8", errors="replace")  # names of files
    return (out / "report.html", *sorted(p for p in out.iterdir() if p.suffix != ".html"))
