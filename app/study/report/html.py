"""The report as one page that needs nothing beside it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

from matplotlib.figure import Figure

from app.study.design.key import Key
from app.study.report import figures, text
from app.study.report.figures import svg_of
from app.study.report.text import NO_BREAK, methods
from app.study.statistics.answers import Collected
from app.study.statistics.preference import Share
from app.study.statistics.results import Balance, QuestionResult
from app.study.statistics.screening import Screened
from conventions.names import printable


def safe(text: str) -> str:
    """Anyone's text for a page."""
    return escape(NO_BREAK.join(map(printable, text.split(NO_BREAK))))


def figure_of(figure: Figure, name: str, description: str, caption: str = "") -> str:
    """An inline figure; ``name`` keeps its ids apart from those of others on the page."""
    below = f"<figcaption>{safe(caption)}</figcaption>" if caption else ""
    svg = svg_of(figure, name, description)
    return f'<div class="wide"><figure>{svg}{below}</figure></div>'


def table(
    caption: str, header: Sequence[str], rows: Iterable[Sequence[str]], names: int = 1
) -> str:
    """A table whose first ``names`` columns are names."""

    is_name = ' class="name"'

    def cells(tag: str, values: Sequence[str]) -> str:
        return "".join(
            f"<{tag}{is_name * (place < names)}>{safe(value)}</{tag}>"
            for place, value in enumerate(values)
        )

    lines = "".join(f"<tr>{cells('td', row)}</tr>" for row in rows)
    return (
        f'<div class="wide"><table><caption>{safe(caption)}</caption>'
        f"<thead><tr>{cells('th', header)}</tr></thead><tbody>{lines}</tbody></table></div>"
    )


def bullets(sentences: Iterable[str]) -> str:
    """A list of sentences."""
    return "<ul>" + "".join(f"<li>{safe(sentence)}</li>" for sentence in sentences) + "</ul>"


MAX_SENTENCES = 200
"""Most files that are told of one by one; the rest are counted."""


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
    key = findings.key
    css = Path(__file__).with_name("report.css").read_text("utf-8")
    body = [
        f"<h1>{safe(key.title)}</h1>",
        f'<p class="about">User study {safe(key.study)}, protocol {key.protocol}, '
        f"{len(key.systems)} systems, {text.counted(len(findings.results), 'question')}.</p>",
        f'<div class="short">{bullets(text.headline(one, key) for one in findings.results)}</div>',
        _bars(findings),
        _people(findings),
        *(_question(one, key) for one in findings.results),
        _set_aside(findings),
        _left_out(findings.collected),
        f"<h2>How this was computed</h2>{bullets(methods(key))}",
    ]
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{safe(key.title)}: results</title>\n<style>\n{css}</style>\n</head>\n<body>\n"
        + "\n".join(body)
        + "\n</body>\n</html>\n"
    )


def _bars(findings: Findings) -> str:
    figure = figures.preference_bars(findings.results, findings.key)
    caption = (
        "Bars are means, whiskers 95 % intervals for other participants on the same clips. "
        "The dashed line is what chance would give."
        if findings.key.protocol != "rating"
        else "Bars are mean ratings, whiskers 95 % intervals for other participants."
    )
    return figure_of(figure, "bars", "Bar chart of all systems by question", caption)


def _people(findings: Findings) -> str:
    key, screened = findings.key, findings.screened
    sentences = text.who_counts(findings.collected, screened, key)
    sentences += text.balance(findings.balance, key)
    rows = [
        (dropped.participant.source, dropped.why) for dropped in screened.dropped[:MAX_SENTENCES]
    ]
    caption = _shortened("Participants who do not count", len(screened.dropped))
    dropped = table(caption, ("file", "why"), rows, names=2) if rows else ""
    seen = table("Where systems were seen", *_seen(findings))
    return "<h2>Participants</h2>" + bullets(sentences) + dropped + seen


def _seen(findings: Findings) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Header and rows; in matched trials both videos are of one system and neither is first."""
    place = "mean place on the list (even: 50 %)"
    balance = findings.balance.systems
    if findings.key.protocol == "matched":
        return ("system", place), [(one.system, text.percent(one.mean_place)) for one in balance]
    together = 2 if findings.key.protocol == "pairwise" else len(findings.key.systems)
    first = f"stood first (even: {text.percent(1 / together)})"
    return ("system", first, place), [
        (one.system, text.percent(one.shown_first), text.percent(one.mean_place)) for one in balance
    ]


def _question(result: QuestionResult, key: Key) -> str:
    is_ranking = result.question.kind == "ranking"
    parts = [
        f"<h2>{safe(result.question.id)}</h2>",
        f'<p class="about">{safe(result.question.text)} '
        f"({text.counted(result.num_answers, 'answer')})</p>",
    ]
    if key.protocol == "matched":
        parts += [bullets(text.match(one, key) for one in result.systems), _matches(result, key)]
    if result.pairs:
        parts += [
            bullets(text.pair(pair, key, is_ranking) for pair in result.pairs),
            _pairs(result, key),
        ]
    if result.means is not None:
        parts += ["<h3>Mean ranks</h3>" if is_ranking else "<h3>Mean ratings</h3>"]
        parts += [bullets(text.means(result.means, key, is_ranking)), _means(result, key)]
    if result.strengths is not None:
        parts += ["<h3>Bradley-Terry strengths</h3>", _strengths(result, key)]
    parts += ["<h3>Quality of the answers</h3>", bullets(_quality(result))]
    if result.jitter is not None:
        parts += ["<h3>Measured jitter and the reasons given</h3>", _jitter(result)]
    return "\n".join(parts)


def _quality(result: QuestionResult) -> Iterable[str]:
    if result.left is not None:
        yield text.left(result.left)
    yield text.agreement(result.agreement)
    yield text.power(result.power)


def _pairs(result: QuestionResult, key: Key) -> str:
    is_tested = result.means is None
    header = ("first", "second", *_SHARE_HEADER, *(("p (Holm)",) if is_tested else ()))
    rows = [
        (
            key.systems[pair.first],
            key.systems[pair.second],
            *_share_cells(pair.share),
            *((text.p_number(pair.p_holm),) if is_tested else ()),
        )
        for pair in result.pairs
    ]
    figure = figures.pair_shares(result, key)
    name = f"pairs-{_slug(result)}"
    return figure_of(figure, name, "Share of votes for the first of each pair, with intervals") + (
        table("All pairs of systems", header, rows, names=2)
    )


_SHARE_HEADER = (
    "won / tie / lost",
    "share",
    "95 % interval",
    "also over clips",
    "participants",
)


def _share_cells(share: Share) -> tuple[str, ...]:
    return (
        f"{share.wins} / {share.ties} / {share.losses}",
        text.percent(share.share),
        text.percent_interval(share.interval),
        text.percent_interval(share.over_clips) if share.over_clips else "\N{EN DASH}",
        f"{share.raters_for} : {share.raters_against}",
    )


def _matches(result: QuestionResult, key: Key) -> str:
    header = ("system", *_SHARE_HEADER, "p (Holm)")
    rows = [
        (
            key.systems[one.system],
            *_share_cells(one.share),
            text.p_number(one.p_holm if one.p_holm is not None else 1),
        )
        for one in result.systems
    ]
    return table("Matching speech against another's", header, rows)


def _means(result: QuestionResult, key: Key) -> str:
    found = result.means
    assert found is not None
    rows = [
        (key.systems[i], text.number(found.mean[i]), text.limits(found.intervals[i]))
        for i in range(len(key.systems))
    ]
    caption = f"Means over {text.counted(found.num_raters, 'participant')}"
    figure = figures.mean_values(result, key)
    name = f"means-{_slug(result)}"
    return figure_of(figure, name, "Mean of each system, with intervals") + (
        table(caption, ("system", "mean", "95 % interval"), rows)
    )


def _strengths(result: QuestionResult, key: Key) -> str:
    found = result.strengths
    assert found is not None
    rows = [
        (name, text.number(found.log_strength[i], "+.2f"), text.limits(found.intervals[i], "+.2f"))
        for i, name in enumerate(key.systems)
    ]
    note = (
        "A system that is 1 above another is preferred e<sup>1</sup> = 2.7 times as often as it, "
        "ties aside."
    )
    if found.tie:
        note += f" Tie parameter (Davidson) {found.tie:.2f}."
    if found.left_advantage is not None and found.left_interval is not None:
        note += (
            f" Standing on the left adds {text.number(found.left_advantage, '+.2f')} "
            f"({text.limits(found.left_interval, '+.2f')}), which is taken out."
        )
    name = f"strengths-{_slug(result)}"
    return (
        figure_of(figures.strengths(result, key), name, "Log-strengths with intervals")
        + table("Log-strengths", ("system", "log-strength", "95 % interval"), rows)
        + f'<p class="note">{note}</p>'
    )


def _jitter(result: QuestionResult) -> str:
    assert result.jitter is not None
    figure = figures.jitter_points(result.jitter)
    name = f"jitter-{_slug(result)}"
    return bullets(text.jitter(result.jitter)) + figure_of(
        figure, name, "Ratio of jerk and share of votes for the smoother video"
    )


def _set_aside(findings: Findings) -> str:
    """Who was set aside, and what the results would be with them."""
    aside = findings.screened.set_aside
    if not aside:
        return ""
    people = table(
        _shortened("Set aside", len(aside)),
        ("file", "why"),
        [(one.participant.source, one.why) for one in aside[:MAX_SENTENCES]],
        names=2,
    )
    without = dict(_compared(findings.results, findings.key))
    rows = [
        (*name, *without.get(name, ("\N{EN DASH}",) * 2), *values)
        for name, values in _compared(findings.results_with_all, findings.key)
    ]
    header = ("question", "compared", "without", "p", "with them", "p")
    both = table("Results without and with those set aside", header, rows, names=2)
    return f"<h2>Set aside</h2><p>{safe(text.set_aside(len(aside)))}</p>{people}{both}"


def _compared(
    results: Sequence[QuestionResult], key: Key
) -> Iterable[tuple[tuple[str, str], tuple[str, str]]]:
    """Question and systems, with the number that a report's reader looks at first and its p."""
    for one in results:
        if one.means is not None:
            for i, name in enumerate(key.systems):
                yield (one.question.id, name), (text.number(one.means.mean[i]), "")
            continue
        for pair in one.pairs:
            name = f"{key.systems[pair.first]} against {key.systems[pair.second]}"
            yield (one.question.id, name), _with_p(pair.share, pair.p_holm)
        for system in one.systems if not one.pairs else ():
            name = key.systems[system.system]
            yield (one.question.id, name), _with_p(system.share, system.p_holm)


def _with_p(share: Share, p: float | None) -> tuple[str, str]:
    return text.percent(share.share), "" if p is None else text.p_number(p)


def _left_out(collected: Collected) -> str:
    if not collected.left_out:
        return "<h2>Left out</h2><p>Every file and every answer could be used.</p>"
    caption = _shortened("Files and answers that could not be used", len(collected.left_out))
    return f"<h2>Left out</h2><p>{caption}:</p>" + bullets(collected.left_out[:MAX_SENTENCES])


def _shortened(caption: str, count: int) -> str:
    return f"{caption} (the first {MAX_SENTENCES} of {count})" if count > MAX_SENTENCES else caption


def _slug(result: QuestionResult) -> str:
    """The question's id as part of an HTML id."""
    return "".join(letter if letter.isalnum() else "-" for letter in result.question.id)
