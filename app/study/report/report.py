"""Report as a self-contained page from templates, its numbers as CSV, and a LaTeX table."""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from dataclasses import astuple, fields, replace
from itertools import combinations
from pathlib import Path
from typing import Any

import jinja2
import pandas as pd
from markupsafe import Markup

from app.study.design.key import StudyKey
from app.study.report import figures
from app.study.statistics.answers import CollectedAnswers, skipped_trials
from app.study.statistics.models import PRIOR_SD, RESAMPLES
from app.study.statistics.proportions import ALPHA, MIN_CLIPS, ResultEstimate
from app.study.statistics.results import AnswerBalance, QuestionResult
from app.study.statistics.screening import SLIDER_TOLERANCE, ScreeningResult
from conventions.names import join_names, pluralise, printable
from model.storage import escaping

NO_BREAK = "\N{NO-BREAK SPACE}"
"""Separator between a number and its unit."""
MAX_LISTED_EXCLUSIONS = 200
"""Most excluded files that are listed; the rest are counted."""
BALANCED_WITHIN = 0.05
"""Largest distance of a side's share from one half that is called balanced."""
_COLUMNS_OF_PARTICIPANTS = ("started", "finished", "included", "why", "answers", "skipped")
_COUNTS = ("wins", "ties", "losses", "participants_for", "participants_against")


def render_report(
    key: StudyKey,
    collected: CollectedAnswers,
    screened: ScreeningResult,
    balance: AnswerBalance,
    results: Sequence[QuestionResult],
    results_with_implausible: Sequence[QuestionResult],
) -> str:
    """Render the page; ``results_with_implausible`` is empty if nobody is implausible."""
    return (
        templates()
        .get_template("report.html.j2")
        .render(
            key=key,
            collected=collected,
            screened=screened,
            skipped=[pages for one in screened.included if (pages := skipped_trials(one))],
            balance=balance,
            results=results,
            results_with_implausible=results_with_implausible,
        )
    )


@functools.cache
def templates() -> jinja2.Environment:
    """Return the template environment, which escapes all values."""
    env = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        finalize=_printable_value,
    )
    forms = (
        percent,
        format_interval_in_percent,
        format_number,
        format_interval,
        format_p,
        format_p_with_letter,
        pluralise,
        better_first,
        headline,
    )
    env.filters |= {form.__name__: form for form in forms}
    env.globals |= {
        "alpha": ALPHA,
        "balanced_within": BALANCED_WITHIN,
        "drawn": _inline_figure,
        "interval": f"95{NO_BREAK}% interval",
        "min_clips": MIN_CLIPS,
        "most": MAX_LISTED_EXCLUSIONS,
        "none_there": "\N{EN DASH}",
        "prior_sd": f"{PRIOR_SD:g}",
        "resamples": RESAMPLES,
        "slider_tolerance": SLIDER_TOLERANCE,
    }
    return env


def _printable_value(value: object) -> object:
    if isinstance(value, str) and not isinstance(value, Markup):
        return NO_BREAK.join(map(printable, value.split(NO_BREAK)))
    return value


def percent(share: float) -> str:
    return f"{100 * share:.0f}{NO_BREAK}%"


def format_interval_in_percent(estimate: ResultEstimate) -> str:
    """Format the interval of a share in percent."""
    _, low, high = estimate.value_and_limits
    return f"{100 * low:.0f} to {100 * high:.0f}{NO_BREAK}%"


def format_number(value: float, form: str = "z.2f") -> str:
    """Format a number with a typographic minus sign."""
    return f"{value:{form}}".replace("-", "\N{MINUS SIGN}")


def format_interval(estimate: ResultEstimate, form: str = "z.2f") -> str:
    """Format an interval as "from to", or "unknown" if it is infinite."""
    _, low, high = estimate.value_and_limits
    if not math.isfinite(high - low):
        return "unknown"
    return f"{format_number(low, form)} to {format_number(high, form)}"


def format_p(p: float) -> str:
    """Format p without leading zero and with three decimals, as papers do."""
    return f"<{NO_BREAK}.001" if p < 0.0005 else f"{min(p, 1):.3f}".removeprefix("0")


def format_p_with_letter(p: float) -> str:
    """Format p with its letter, for example "p = .012"."""
    shown = format_p(p)
    return f"p{NO_BREAK}{shown}" if shown.startswith("<") else f"p{NO_BREAK}={NO_BREAK}{shown}"


def better_first(gap: ResultEstimate, is_ranking: bool) -> ResultEstimate:
    """Return the difference of two means as positive, with the better system first."""
    is_first = (gap.value_and_limits[0] > 0) != is_ranking
    one = gap if is_first else gap.with_systems_swapped()
    value, low, high = one.value_and_limits
    return replace(one, value=-value, low=-high, high=-low) if is_ranking else one


def headline(result: QuestionResult) -> str:
    """Describe which system ranks first and which of the printed differences are significant."""
    name = f"{result.question.id}: "
    if matches := result.estimates_of("right_choices"):
        good = [str(one.first) for one in matches if one.significant_side > 0]
        if not good:
            return (
                f"{name}the matching speech was not chosen significantly more often than chance "
                "for any system."
            )
        return (
            f"{name}the matching speech was chosen significantly more often than chance for "
            f"{join_names(good)} ({len(good)} of {pluralise(len(matches), 'system')})."
        )
    ranks, ratings = result.estimates_of("mean_rank"), result.estimates_of("mean_rating")
    sign = 1 if ranks else -1
    scores = ranks or ratings or result.estimates_of("log_strength")
    scores = sorted(scores, key=lambda one: sign * one.value_and_limits[0])
    order = [str(one.first) for one in scores]
    if len(order) < 2:
        return f"{name}there are too few answers to compare systems."
    measure = f"{scores[0].measure}_gap" if ranks or ratings else "share"
    better = -1 if ranks else 1

    def lead(one: str, other: str) -> int:
        """Return 1 if the first system is significantly better, -1 if worse, else 0."""
        estimate = result.find_estimate(measure, one, other)
        return better * estimate.significant_side if estimate else 0

    best, *others = order
    beaten = [other for other in others if lead(best, other) > 0]
    if beaten == others:
        return f"{name}{best} is significantly better than {join_names(others)}."
    ahead_of_best = [other for other in others if lead(best, other) < 0]
    alike = [best, *(other for other in others if lead(best, other) == 0)]
    lines = []
    if any(lead(*pair) for pair in combinations(alike, 2)):
        lines.append(f"{best} does not differ significantly from {join_names(alike[1:])}")
    elif len(alike) > 1:
        lines.append(f"{join_names(alike)} do not differ significantly")
    if len(order) == 2 and measure == "share" and (votes := result.find_estimate("share", *order)):
        ties = f", {pluralise(votes.ties, 'tie')}" if votes.ties else ""
        lines[:1] = [f"{lines[0]}: {votes.wins} and {votes.losses} votes{ties}"] if lines else []
    if beaten:
        lines.append(f"{best} is significantly better than {join_names(beaten)}")
    if ahead_of_best:
        lines.append(
            f"{best} ranks first overall, but {join_names(ahead_of_best)} "
            f"{'is' if len(ahead_of_best) == 1 else 'are'} significantly better than {best} in "
            "direct comparison"
        )
    friedman = result.find_estimate("friedman")
    if alike == order and friedman and friedman.is_significant:
        lines.append("but Friedman's test finds a significant difference between the systems")
    return f"{name}{'; '.join(lines)}."


def _inline_figure(kind: str, name: str, description: str, *about: Any) -> Markup:
    """Return a figure as inline SVG."""
    return Markup(figures.figure_to_svg(getattr(figures, kind)(*about), name, description))


def results_csv(results: Sequence[QuestionResult]) -> str:
    """Format one row per number as CSV, with empty cells for missing values; shares are 0 to 1."""
    names = [field.name for field in fields(ResultEstimate)]
    rows: list[Sequence[object]] = [("question", *names)]
    for result in results:
        for one in result.estimates:
            cells = dict(zip(names, astuple(one), strict=True))
            if not one.num_votes:
                cells |= dict.fromkeys(_COUNTS)
            shown = (_digits(v) if isinstance(v, float) else v for v in cells.values())
            rows.append((result.question.id, *shown))
    return escaping.csv_text(rows)


def participants_csv(key: StudyKey, screened: ScreeningResult) -> str:
    """Format one row per participant as CSV: inclusion, skipped pages and ids of the panel."""
    rows: list[Sequence[object]] = [
        ("file", "participant", *key.panel_id_names, "list", *_COLUMNS_OF_PARTICIPANTS)
    ]
    states = [(one, "yes", "") for one in screened.included]
    states += [(each.participant, "no", each.reason) for each in screened.excluded]
    states += [(each.participant, "implausible", each.reason) for each in screened.implausible]
    for one, counts, why in states:
        ids = (one.panel_values.get(name, "") for name in key.panel_id_names)
        times = (one.started.isoformat(), one.finished.isoformat() if one.finished else "")
        about = (one.file_name, one.id, *ids, one.list_number, *times, counts, why)
        rows.append((*about, len(one.answers), len(skipped_trials(one))))
    return escaping.csv_text(rows)


def _digits(value: float) -> str | None:
    """Format a number with six digits; None for the limits of an unknown interval."""
    return f"{value:.6g}" if math.isfinite(value) else None


def latex_table(results: Sequence[QuestionResult], key: StudyKey) -> str:
    """Return a table of systems by questions with the bar chart's numbers (needs booktabs)."""
    captions = {
        "right_choices": (
            "Percentage of correct choices (ties count as half), with 95 % confidence intervals."
        ),
        "first_places": "Percentage of first places, with 95 % confidence intervals.",
        "share_of_all_votes": (
            "Percentage of votes over all comparisons, with 95 % confidence intervals."
        ),
        "mean_rating": "Mean ratings, with 95 % confidence intervals.",
    }
    table = pd.DataFrame({"System": map(escaping.escape_latex, key.systems)})
    for result in results:
        cells = [_latex_cell(result.find_estimate(result.bar_measure, one)) for one in key.systems]
        table[escaping.escape_latex(result.question.id)] = cells
    tabular = table.to_latex(index=False, escape=False, column_format="l" + "c" * len(results))
    return f"% Needs \\usepackage{{booktabs}}. {captions[results[0].bar_measure]}\n{tabular}"


def _latex_cell(one: ResultEstimate | None) -> str:
    if one is None:
        return "--"
    scale, digits = (1, 1) if one.measure == "mean_rating" else (100, 0)
    numbers = one.value_and_limits
    value, low, high = (f"{scale * each:.{digits}f}" for each in numbers)
    return f"{value} [{low}, {high}]" if math.isfinite(numbers[2]) else f"{value} [unknown]"
