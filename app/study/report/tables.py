"""The report's numbers as CSV and its main ones as a LaTeX table."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from app.study.design.key import Key
from app.study.statistics.preference import Interval, Share
from app.study.statistics.results import QuestionResult
from model.storage import harmless

CSV_HEADER = (
    "question", "measure", "first", "second", "value", "low", "high", "p", "p_holm",
    "wins", "ties", "losses", "participants_for", "participants_against",
)  # fmt: skip
Row = dict[str, object]


def write_csv(results: Sequence[QuestionResult], key: Key, path: Path) -> None:
    """One row for each number; what a row does not have is empty. Shares are 0 to 1."""
    path.write_text(harmless.csv_text([CSV_HEADER, *_lines(results, key)]), "utf-8", newline="")


def _lines(results: Sequence[QuestionResult], key: Key) -> Iterator[list[object]]:
    for result in results:
        for row in _rows(result, key):
            whole = {"question": result.question.id, **row}
            yield [whole.get(name) for name in CSV_HEADER]


def _rows(result: QuestionResult, key: Key) -> Iterator[Row]:
    names = key.systems
    for pair in result.pairs:
        about: Row = {"first": names[pair.first], "second": names[pair.second]}
        yield from _share_rows("share", pair.share, pair.p_holm, about)
    for one in result.systems:
        measure = "right_choices" if key.protocol == "matched" else _system_measure(result)
        yield from _share_rows(measure, one.share, one.p_holm, {"first": names[one.system]})
    if result.strengths is not None:
        for system, name in enumerate(names):
            interval = result.strengths.intervals[system]
            value = float(result.strengths.log_strength[system])
            yield _row("log_strength", value, interval, first=name)
        for (a, b), (gap, interval) in result.strengths.differences.items():
            yield _row("log_strength_gap", gap, interval, first=names[a], second=names[b])
        yield _row("tie_parameter", result.strengths.tie)
        if result.strengths.left_advantage is not None:
            found = result.strengths
            yield _row("left_advantage", found.left_advantage, found.left_interval)
    yield from _mean_rows(result, names)
    if result.left is not None:
        yield from _share_rows("left_chosen", result.left, None, {})
    yield _row(f"krippendorff_alpha_{result.agreement.level}", result.agreement.alpha)
    yield _row("detectable_share_of_participants", result.power.share_alone)
    yield from _jitter_rows(result)


def _mean_rows(result: QuestionResult, names: Sequence[str]) -> Iterator[Row]:
    if result.means is None:
        return
    measure = "mean_rank" if result.question.kind == "ranking" else "mean_rating"
    for system, name in enumerate(names):
        mean, interval = float(result.means.mean[system]), result.means.intervals[system]
        yield _row(measure, mean, interval, first=name)
    for test in result.means.pairs:
        about = {"first": names[test.first], "second": names[test.second]}
        tested = {"p": test.p, "p_holm": test.p_holm}
        yield _row(f"{measure}_gap", test.difference, test.interval, **about, **tested)
    yield _row("friedman", None, p=result.means.friedman_p)


def _jitter_rows(result: QuestionResult) -> Iterator[Row]:
    found = result.jitter
    if found is None:
        return
    for measure, share in (
        ("smoother_chosen_naming_smoothness", found.because_smooth),
        ("smoother_chosen_otherwise", found.other_reasons),
    ):
        if share is not None:
            yield from _share_rows(measure, share, None, {})
    yield _row("jerk_ratio_share_spearman", found.correlation, p=found.correlation_p)


def _system_measure(result: QuestionResult) -> str:
    return "first_places" if result.question.kind == "ranking" else "share_of_all_votes"


def _share_rows(measure: str, share: Share, p_holm: float | None, about: Row) -> Iterator[Row]:
    """The share, and the same with the two other intervals."""
    counts = {
        "wins": share.wins,
        "ties": share.ties,
        "losses": share.losses,
        "participants_for": share.raters_for,
        "participants_against": share.raters_against,
    }
    is_tested = measure not in ("first_places", "share_of_all_votes")
    tested = {"p": share.p if is_tested else None, "p_holm": p_holm}
    yield _row(measure, share.share, share.interval, **about, **tested, **counts)
    if share.over_clips is not None:
        yield _row(f"{measure}_also_over_clips", share.share, share.over_clips, **about)
    if share.wins + share.losses:
        decided = share.wins / (share.wins + share.losses)
        plain = f"{measure}_of_decided_as_if_independent"
        yield _row(plain, decided, share.as_independent, **about)


def _row(
    measure: str, value: float | None, interval: Interval | None = None, **others: object
) -> Row:
    limits = {"low": interval.low, "high": interval.high} if interval else {}
    row: Row = {"measure": measure, "value": value, **limits, **others}
    return {name: f"{cell:.6g}" if isinstance(cell, float) else cell for name, cell in row.items()}


def latex_table(results: Sequence[QuestionResult], key: Key) -> str:
    """Systems by questions: the numbers of the bar chart with their intervals (needs booktabs)."""
    questions = " & ".join(harmless.tex(result.question.id) for result in results)
    lines = [
        "% Needs \\usepackage{booktabs}. " + _latex_caption(results, key),
        f"\\begin{{tabular}}{{l{'c' * len(results)}}}",
        "\\toprule",
        f"System & {questions} \\\\",
        "\\midrule",
    ]
    for system, name in enumerate(key.systems):
        cells = " & ".join(_latex_cell(result, system) for result in results)
        lines.append(f"{harmless.tex(name)} & {cells} \\\\")
    return "\n".join([*lines, "\\bottomrule", "\\end{tabular}"]) + "\n"


def _latex_caption(results: Sequence[QuestionResult], key: Key) -> str:
    if key.protocol == "rating":
        return "Mean ratings, 95 % intervals."
    if key.protocol == "matched":
        return "Right choices in per cent, ties half, 95 % intervals."
    is_ranking = any(result.question.kind == "ranking" for result in results)
    what = "First places" if is_ranking else "Votes in all comparisons"
    return f"{what} in per cent, 95 % intervals."


def _latex_cell(result: QuestionResult, system: int) -> str:
    if result.question.kind == "slider" and result.means is not None:
        return _latex_number(float(result.means.mean[system]), result.means.intervals[system], 1)
    for one in result.systems:
        if one.system == system:
            low, high = one.share.interval.low, one.share.interval.high
            return _latex_number(100 * one.share.share, Interval(100 * low, 100 * high), 0)
    return "--"


def _latex_number(value: float, interval: Interval, digits: int) -> str:
    return f"{value:.{digits}f} [{interval.low:.{digits}f}, {interval.high:.{digits}f}]"
