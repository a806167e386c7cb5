"""The report as one page that needs nothing beside it, its numbers as CSV and its main ones as a
LaTeX table. Sentences and layout are in the templates beside this file."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable, Sequence
from dataclasses import astuple, dataclass, fields, replace
from pathlib import Path
from typing import Any

import jinja2
import pandas as pd
from markupsafe import Markup

from app.study.design.key import Key
from app.study.report import figures
from app.study.statistics.answers import Collected
from app.study.statistics.models import PRIOR_SD, RESAMPLES
from app.study.statistics.results import Balance, QuestionResult
from app.study.statistics.screening import SLIDER_TOLERANCE, Dropped, Screened
from app.study.statistics.shares import ALPHA, MIN_CLIPS, Number
from conventions.names import listed, printable
from model.storage import harmless

NO_BREAK = "\N{NO-BREAK SPACE}"
"""Between a number and what belongs to it."""
NONE = "\N{EN DASH}"
MAX_SENTENCES = 200
"""Most files that are told of one by one; the rest are counted."""
BALANCED_WITHIN = 0.05
"""Sides this near to one half are called balanced."""
SHARE_HEADER = ["won / tie / lost", "share", "95 % interval", "also over clips", "participants"]
_COUNTS = ("wins", "ties", "losses", "participants_for", "participants_against")


@dataclass(frozen=True)
class Findings:
    """Everything that a report tells."""

    key: Key
    collected: Collected
    screened: Screened
    balance: Balance
    results: Sequence[QuestionResult]
    results_with_all: Sequence[QuestionResult] = ()
    """Of those set aside too; empty where there are none."""


def page_of(findings: Findings) -> str:
    """The whole page."""
    template = templates().get_template("report.html.j2")
    return template.render(**vars(findings), figures=_figures(findings.results, findings.key))


@functools.cache
def templates() -> jinja2.Environment:
    """Where anyone's text stays text, whatever letters it has."""
    env = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        finalize=_shown,
    )
    env.filters |= {
        **{"percent": percent, "percents": percents, "number": number, "limits": limits},
        **{"p_value": p_value, "counted": counted, "ahead": ahead, "headline": headline},
        **{"rows": _rows, "share_rows": _share_rows, "strength_rows": _strength_rows},
        **{"people": _people, "seen": _seen, "compared": _compared_rows},
    }
    env.globals |= {
        "alpha": ALPHA,
        "balanced_within": BALANCED_WITHIN,
        "interval": f"95{NO_BREAK}% interval",
        "min_clips": MIN_CLIPS,
        "most": MAX_SENTENCES,
        "prior_sd": f"{PRIOR_SD:g}",
        "resamples": RESAMPLES,
        "share_header": SHARE_HEADER,
        "slider_tolerance": SLIDER_TOLERANCE,
    }
    return env


def _shown(value: object) -> object:
    if isinstance(value, str) and not isinstance(value, Markup):
        return NO_BREAK.join(map(printable, value.split(NO_BREAK)))
    return value


def say(sentence: str, *about: Any) -> str:
    """One of the sentences of the report."""
    template = templates().get_template("sentences.j2")
    return str(getattr(template.module, sentence)(*about))


def percent(share: float) -> str:
    return f"{100 * share:.0f}{NO_BREAK}%"


def percents(found: Number) -> str:
    """Its interval."""
    _, low, high = found.limits
    return f"{100 * low:.0f} to {100 * high:.0f}{NO_BREAK}%"


def number(value: float, form: str = ".2f") -> str:
    """With a true minus sign."""
    return f"{value:{form}}".replace("-", "\N{MINUS SIGN}")


def limits(found: Number, form: str = ".2f") -> str:
    """From and to; one participant alone gives none."""
    _, low, high = found.limits
    if not math.isfinite(high - low):
        return "unknown"
    return f"{number(low, form)} to {number(high, form)}"


def p_number(p: float) -> str:
    """As papers print it: no leading zero, three decimals."""
    return f"<{NO_BREAK}.001" if p < 0.0005 else f"{min(p, 1):.3f}".removeprefix("0")


def p_value(p: float) -> str:
    """The same with its letter."""
    shown = p_number(p)
    return f"p{NO_BREAK}{shown}" if shown.startswith("<") else f"p{NO_BREAK}={NO_BREAK}{shown}"


def counted(count: int, noun: str) -> str:
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def ahead(gap: Number, is_ranking: bool) -> Number:
    """The difference of two means with the better system first and above 0."""
    is_first = (gap.limits[0] > 0) != is_ranking
    one = gap if is_first else gap.from_the_other_side()
    value, low, high = one.limits
    return replace(one, value=-value, low=-high, high=-low) if is_ranking else one


def headline(result: QuestionResult) -> str:
    """Which system came out best, and how surely."""
    name = f"{result.question.id}: "
    if matches := result.all("right_choices"):
        good = [str(one.first) for one in matches if one.beyond > 0]
        if not good:
            return f"{name}for no system was the matching speech told from another's beyond chance."
        return (
            f"{name}the matching speech was told from another's beyond chance for {listed(good)} "
            f"({len(good)} of {counted(len(matches), 'system')})."
        )
    ranks, ratings = result.all("mean_rank"), result.all("mean_rating")
    sign = 1 if ranks else -1
    scores = ranks or ratings or result.all("log_strength")
    order = [str(one.first) for one in sorted(scores, key=lambda one: sign * one.limits[0])]
    if len(order) < 2:
        return f"{name}there are too few answers to compare systems."
    best, *others = order
    if ranks or ratings:
        gaps = [(other, result.one(f"{scores[0].measure}_gap", best, other)) for other in others]
        beaten = [other for other, gap in gaps if gap and (gap.p_holm or 0) < ALPHA]
    else:
        pairs = [(other, result.one("share", best, other)) for other in others]
        beaten = [other for other, pair in pairs if pair and pair.beyond > 0]
    if beaten == others:
        return f"{name}{best} came first, ahead of every other system beyond chance."
    alike = listed([system for system in order if system not in beaten])
    sentence = f"{name}{alike} are not told apart"
    votes = (
        result.one("share", best, others[0]) if len(order) == 2 and not (ranks or ratings) else None
    )
    if votes:
        ties = f", {counted(votes.ties, 'tie')}" if votes.ties else ""
        return f"{sentence}: {votes.wins} and {votes.losses} votes{ties}."
    if beaten:
        return f"{sentence}; {best} is ahead of {listed(beaten)} beyond chance."
    return f"{sentence}."


Row = tuple[str, ...]


def _rows(result: QuestionResult, measure: str, form: str = ".2f") -> list[Row]:
    """System, value and interval."""
    return [
        (str(one.first), number(one.limits[0], form), limits(one, form))
        for one in result.all(measure)
    ]


def _strength_rows(result: QuestionResult) -> list[Row]:
    elo = {name: cells for name, *cells in _rows(result, "elo", ".0f")}
    return [(*row, *elo[row[0]]) for row in _rows(result, "log_strength", "+.2f")]


def _share_rows(result: QuestionResult, num_names: int) -> Iterable[Row]:
    measure = "share" if num_names == 2 else "right_choices"
    over_clips = {
        (one.first, one.second): percents(one) for one in result.all(f"{measure}_also_over_clips")
    }
    for one in result.all(measure):
        names = (str(one.first), str(one.second))[:num_names]
        yield (
            *names,
            f"{one.wins} / {one.ties} / {one.losses}",
            percent(one.limits[0]),
            percents(one),
            over_clips.get((one.first, one.second), NONE),
            f"{one.participants_for} : {one.participants_against}",
            *(() if result.question.kind == "ranking" else (p_number(one.p_holm or 0),)),
        )


def _people(dropped: Sequence[Dropped]) -> list[Row]:
    return [(one.participant.source, one.why) for one in dropped[:MAX_SENTENCES]]


def _seen(systems: pd.DataFrame, has_first: int) -> list[Row]:
    columns = ["first", "place"] if has_first else ["place"]
    return [(str(name), *map(percent, row[columns])) for name, row in systems.iterrows()]


def _compared_rows(
    results: Sequence[QuestionResult], results_with_all: Sequence[QuestionResult]
) -> list[Row]:
    """Question and systems, with the number that a report's reader looks at first and its p,
    without and with those set aside."""
    without = dict(_compared(results))
    return [
        (*name, *without.get(name, (NONE, NONE)), *cells)
        for name, cells in _compared(results_with_all)
    ]


def _compared(results: Sequence[QuestionResult]) -> Iterable[tuple[Row, Row]]:
    for result in results:
        name = result.question.id
        means = result.all("mean_rank") or result.all("mean_rating")
        for one in means:
            yield (name, str(one.first)), (number(one.limits[0]), "")
        shares = result.all("share") or result.all("right_choices")
        for one in () if means else shares:
            who = f"{one.first} against {one.second}" if one.second else str(one.first)
            yield (name, who), (percent(one.limits[0]), p_number(one.p_holm or 0))


def _figures(results: Sequence[QuestionResult], key: Key) -> dict[Any, Markup]:
    """By question and kind, and the bars of all."""
    drawn: dict[Any, Markup] = {}

    def add(at: Any, figure: Any, name: str, description: str) -> None:
        drawn[at] = Markup(figures.svg_of(figure, name, description))

    bars = figures.preference_bars(results, key)
    add("bars", bars, "bars", "Bar chart of all systems by question")
    for number_of, result in enumerate(results):
        name = result.question.id
        about = "Share of votes for the first of each pair, with intervals"
        if shares := result.all("share"):
            add((name, "pairs"), figures.pair_shares(shares), f"pairs-{number_of}", about)
        if result.num_of_means:
            about = "Mean of each system, with intervals"
            add((name, "means"), figures.mean_values(result), f"means-{number_of}", about)
        if strengths := result.all("log_strength"):
            about = "Log-strengths with intervals"
            add((name, "strengths"), figures.strengths(strengths), f"strengths-{number_of}", about)
        if len(result.points):
            about = "Ratio of jerk and share of votes for the smoother video"
            add(
                (name, "jitter"), figures.jitter_points(result.points), f"jitter-{number_of}", about
            )
    return drawn


def csv_of(results: Sequence[QuestionResult]) -> str:
    """One row for each number; what a row does not have is empty. Shares are 0 to 1."""
    names = [field.name for field in fields(Number)]
    rows: list[Sequence[object]] = [("question", *names)]
    for result in results:
        for one in result.numbers:
            cells = dict(zip(names, astuple(one), strict=True))
            if not one.votes:
                cells |= dict.fromkeys(_COUNTS)
            shown = (f"{v:.6g}" if isinstance(v, float) else v for v in cells.values())
            rows.append((result.question.id, *shown))
    return harmless.csv_text(rows)


def latex_table(results: Sequence[QuestionResult], key: Key) -> str:
    """Systems by questions: the numbers of the bar chart with their intervals (needs booktabs)."""
    captions = {
        "right_choices": "Right choices in per cent, ties half, 95 % intervals.",
        "first_places": "First places in per cent, 95 % intervals.",
        "share_of_all_votes": "Votes in all comparisons in per cent, 95 % intervals.",
        "mean_rating": "Mean ratings, 95 % intervals.",
    }
    table = pd.DataFrame({"System": map(harmless.tex, key.systems)})
    for result in results:
        cells = [_latex_cell(result.one(result.ends, name)) for name in key.systems]
        table[harmless.tex(result.question.id)] = cells
    tabular = table.to_latex(index=False, escape=False, column_format="l" + "c" * len(results))
    return f"% Needs \\usepackage{{booktabs}}. {captions[results[0].ends]}\n{tabular}"


def _latex_cell(one: Number | None) -> str:
    if one is None:
        return "--"
    scale, digits = (1, 1) if one.measure == "mean_rating" else (100, 0)
    value, low, high = (f"{scale * each:.{digits}f}" for each in one.limits)
    return f"{value} [{low}, {high}]"
