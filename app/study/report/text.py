"""The report's sentences, made from numbers, each able to say the opposite; and its methods."""

from __future__ import annotations

import math

from app.study.design.key import Key
from app.study.statistics.answers import Collected
from app.study.statistics.bradley_terry import PRIOR_SD
from app.study.statistics.jitter_join import JitterJoin
from app.study.statistics.means import MeanValues, PairedTest
from app.study.statistics.preference import ALPHA, MIN_CLIPS, RESAMPLES, Interval, Share
from app.study.statistics.results import (
    Agreement,
    Balance,
    PairResult,
    Power,
    QuestionResult,
    SystemResult,
)
from app.study.statistics.screening import SLIDER_TOLERANCE, Screened
from conventions.names import listed

NO_BREAK = "\N{NO-BREAK SPACE}"
"""Between a number and what belongs to it."""
INTERVAL = f"95{NO_BREAK}% interval"
BALANCED_WITHIN = 0.05
"""Sides this near to one half are called balanced."""


def percent(share: float) -> str:
    return f"{100 * share:.0f}{NO_BREAK}%"


def percent_interval(interval: Interval) -> str:
    return f"{100 * interval.low:.0f} to {100 * interval.high:.0f}{NO_BREAK}%"


def number(value: float, form: str = ".2f") -> str:
    """With a true minus sign."""
    return f"{value:{form}}".replace("-", "\N{MINUS SIGN}")


def limits(interval: Interval, form: str = ".2f") -> str:
    """From and to; one participant alone gives none."""
    if not math.isfinite(interval.high - interval.low):
        return "unknown"
    return f"{number(interval.low, form)} to {number(interval.high, form)}"


def p_number(p: float) -> str:
    """As papers print it: no leading zero, three decimals."""
    return f"<{NO_BREAK}.001" if p < 0.0005 else f"{min(p, 1):.3f}".removeprefix("0")


def p_value(p: float) -> str:
    """The same with its letter."""
    shown = p_number(p)
    return f"p{NO_BREAK}{shown}" if shown.startswith("<") else f"p{NO_BREAK}={NO_BREAK}{shown}"


def counted(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def who_counts(collected: Collected, screened: Screened, key: Key) -> list[str]:
    """How many take part, and by what rule."""
    kept, everybody = len(screened.kept), len(collected.participants)
    most = counted(key.max_failed, "attention check")
    rule = f"failed at most {most}" if key.max_failed else "failed no attention check"
    sentences = [
        f"{kept} of {counted(everybody, 'participant')} count; {key.participants} were planned.",
        f"A participant counts who finished and {rule}; one left without an answer is failed.",
    ]
    failed_sound = sum(one.headphones == "failed" for one in screened.kept)
    if failed_sound:
        verb = "counts" if failed_sound == 1 else "count"
        sentences.append(
            f"{failed_sound} of those who count failed the headphone check and {verb}."
        )
    return sentences


def set_aside(count: int) -> str:
    """Why some do not count who finished."""
    who = "1 finished participant is" if count == 1 else f"{count} finished participants are"
    return (
        f"{who} not in the results above: times or answers are not such as the page sends and "
        "people give. That proves nothing about anyone; the table shows what they would change."
    )


def balance(reached: Balance, key: Key) -> list[str]:
    """Lists, sides and order."""
    used = f"{reached.lists_used} of {counted(reached.lists_planned, 'list')} were used"
    most = counted(reached.most_of_one_list, "participant")
    sentences = [f"{used}, the most used by {most}."]
    if key.protocol == "pairwise" and reached.systems:
        shares = [one.shown_first for one in reached.systems]
        is_even = max(abs(share - 0.5) for share in shares) <= BALANCED_WITHIN
        verdict = "sides are balanced" if is_even else "sides are not balanced"
        sentences.append(
            f"Systems stood on the left in {percent(min(shares))} to {percent(max(shares))} "
            f"of their comparisons: {verdict}."
        )
    return sentences


def headline(result: QuestionResult, key: Key) -> str:
    """Which system came out best, and how surely."""
    name = f"{result.question.id}: "
    if key.protocol == "matched":
        good = [one for one in result.systems if _is_beyond(one.share, one.p_holm, above=True)]
        if not good:
            return f"{name}for no system was the matching speech told from another's beyond chance."
        names = listed([key.systems[one.system] for one in good])
        return (
            f"{name}the matching speech was told from another's beyond chance for {names} "
            f"({len(good)} of {counted(len(result.systems), 'system')})."
        )
    order = _order(result)
    if len(order) < 2:
        return f"{name}there are too few answers to compare systems."
    best = order[0]
    beaten = [other for other in order[1:] if _beats(result, best, other)]
    if len(beaten) == len(order) - 1:
        return f"{name}{key.systems[best]} came first, ahead of every other system beyond chance."
    alike = [system for system in order if system not in beaten]
    sentence = f"{name}{listed([key.systems[system] for system in alike])} are not told apart"
    if len(order) == 2 and result.means is None:
        (votes,) = (pair.share for pair in result.pairs)
        first, second = votes.wins, votes.losses
        if result.pairs[0].first != best:
            first, second = second, first
        ties = f", {counted(votes.ties, 'tie')}" if votes.ties else ""
        return f"{sentence}: {first} and {second} votes{ties}."
    if beaten:
        behind = listed([key.systems[system] for system in beaten])
        return f"{sentence}; {key.systems[best]} is ahead of {behind} beyond chance."
    return f"{sentence}."


def _order(result: QuestionResult) -> list[int]:
    """Systems from best to worst."""
    if result.means is not None:
        sign = -1 if result.question.kind == "ranking" else 1
        scores = list(sign * result.means.mean)
    elif result.strengths is not None:
        scores = list(result.strengths.log_strength)
    else:
        return []
    return sorted(range(len(scores)), key=lambda system: -scores[system])


def _beats(result: QuestionResult, best: int, other: int) -> bool:
    if result.means is not None:
        tests = {frozenset((test.first, test.second)): test for test in result.means.pairs}
        return tests[frozenset((best, other))].p_holm < ALPHA
    for pair in result.pairs:
        if {pair.first, pair.second} == {best, other}:
            return _is_beyond(pair.share, pair.p_holm, above=pair.first == best)
    return False


def _is_beyond(share: Share, p: float | None, above: bool) -> bool:
    """Whether votes and participants lean to that side, and these beyond chance."""
    lead = share.raters_for - share.raters_against
    sign = 1 if above else -1
    return p is not None and p < ALPHA and sign * lead > 0 and sign * (share.share - 0.5) > 0


def pair(result: PairResult, key: Key, is_ranking: bool) -> str:
    """Two systems; the one with more votes is named first.

    Rankings are told apart by their means (see `means`): one verdict for each pair is enough.
    """
    first, second, share = key.systems[result.first], key.systems[result.second], result.share
    if share.share == 0.5:
        return f"{first} and {second} share their {share.votes} votes evenly."
    won, interval = share.share, share.interval
    leaning, other = share.raters_for, share.raters_against
    if won < 0.5:
        first, second = second, first
        won, interval = 1 - won, Interval(1 - interval.high, 1 - interval.low)
        leaning, other = other, leaning
    sentence = (
        f"{first} has {percent(won)} of {share.votes} votes against {second} ({INTERVAL} "
        f"{percent_interval(interval)}); {counted(leaning, 'participant')} leaned to it, "
        f"{other} to the other"
    )
    if is_ranking:
        return f"{sentence}."
    is_beyond = _is_beyond(share, result.p_holm, above=share.share > 0.5)
    verdict = "this is beyond chance" if is_beyond else "this does not tell them apart"
    return f"{sentence}: {verdict} ({p_value(result.p_holm)} after Holm)."


def match(result: SystemResult, key: Key) -> str:
    """Whether a system's own speech was recognised."""
    share, p = result.share, result.p_holm
    if _is_beyond(share, p, above=True):
        verdict = "its motion fits its speech beyond chance"
    elif _is_beyond(share, p, above=False):
        verdict = "another's speech fits its motion better than its own, beyond chance"
    else:
        verdict = "its own speech was not told from another's"
    return (
        f"{key.systems[result.system]}: the matching speech was picked in {percent(share.share)} "
        f"of {share.votes} trials ({INTERVAL} {percent_interval(share.interval)}): {verdict} "
        f"({p_value(p if p is not None else 1)} after Holm)."
    )


def means(result: MeanValues, key: Key, is_ranking: bool) -> list[str]:
    """Friedman's verdict, and the pairs that differ."""
    what = "rank" if is_ranking else "rating"
    sentences = []
    if result.friedman_p is not None:
        differ = "differ" if result.friedman_p < ALPHA else "do not differ"
        sentences.append(
            f"Mean {what}s of {counted(result.num_raters, 'participant')} {differ} beyond chance "
            f"between systems (Friedman, {p_value(result.friedman_p)})."
        )
    sentences += [_mean_pair(test, key, is_ranking) for test in result.pairs]
    return sentences


def _mean_pair(test: PairedTest, key: Key, is_ranking: bool) -> str:
    """Two systems; the better one is named first."""
    better, worse = key.systems[test.first], key.systems[test.second]
    lead, interval = test.difference, test.interval
    if (lead > 0) == is_ranking:
        better, worse = worse, better
    if lead < 0:
        lead, interval = -lead, Interval(-interval.high, -interval.low)
    more = "places better" if is_ranking else "points higher"
    verdict = "this is beyond chance" if test.p_holm < ALPHA else "this does not tell them apart"
    return (
        f"{better} is {number(lead)} {more} than {worse} ({INTERVAL} "
        f"{limits(interval)}): {verdict} (Wilcoxon, {p_value(test.p_holm)} after Holm)."
    )


def left(share: Share) -> str:
    """Whether a side was favoured."""
    side = "left" if share.share > 0.5 else "right"
    is_favoured = _is_beyond(share, share.p, above=share.share > 0.5)
    verdict = f"the {side} was favoured beyond chance" if is_favoured else "no side was favoured"
    return (
        f"The left video was chosen in {percent(share.share)} of votes, ties half "
        f"({INTERVAL} {percent_interval(share.interval)}): {verdict} ({p_value(share.p)})."
    )


def agreement(found: Agreement) -> str:
    """Krippendorff's alpha by his own marks: .8 is reliable, .667 the least to build on."""
    if found.alpha is None:
        return "Agreement has no value: nothing was judged differently, or by two raters."
    if found.alpha >= 0.8:
        verdict = "raters agree well"
    elif found.alpha >= 0.667:
        verdict = "raters agree fairly"
    elif found.alpha > 0:
        verdict = "single answers agree little, so only means over many raters say something"
    else:
        verdict = "single answers agree no more than by chance"
    return (
        f"Krippendorff's alpha ({found.level}) over {found.units} things judged by two or more is "
        f"{number(found.alpha)}: {verdict}."
    )


def power(found: Power) -> str:
    """What this many participants can see."""
    if found.share_alone is None:
        return (
            f"{counted(found.raters, 'participant')} cannot make the sign test significant, "
            "however they answer; at least 6 are needed."
        )
    sentence = (
        f"With {found.raters} participants the sign test finds, 8 times in 10, a side that "
        f"{percent(found.share_alone)} of participants lean to"
    )
    if found.comparisons < 2:
        return f"{sentence}."
    if found.share_strictest is None:
        return f"{sentence}; after Holm's correction over {found.comparisons} it can find none."
    return (
        f"{sentence}; at Holm's strictest step over {found.comparisons} comparisons, "
        f"{percent(found.share_strictest)}."
    )


def jitter(found: JitterJoin) -> list[str]:
    """Whether people who spoke of smoothness chose what measures smoother."""
    sentences = []
    for share, who in (
        (found.because_smooth, "named motion smoothness"),
        (found.other_reasons, "did not name it"),
    ):
        if share is None:
            sentences.append(f"No decided vote {who}.")
            continue
        above, below = share.interval.low > 0.5, share.interval.high < 0.5
        verdict = (
            "more often than" if above else "less often than" if below else "about as often as"
        )
        sentences.append(
            f"Of {counted(share.votes, 'decided vote')} that {who}, {percent(share.share)} went to "
            f"the video with less measured jerk ({INTERVAL} "
            f"{percent_interval(share.interval)}): {verdict} by chance."
        )
    if found.correlation is not None and found.correlation_p is not None:
        told = "go together" if found.correlation_p < ALPHA else "are not shown to go together"
        sentences.append(
            f"Over {len(found.points)} pairs of videos, the ratio of jerk and the share of the "
            f"smoother {told} (Spearman {number(found.correlation, '+.2f')}, "
            f"{p_value(found.correlation_p)}; pairs share clips and participants, so that p is "
            "only a guide)."
        )
    return sentences


def methods(key: Key) -> list[str]:
    """Sentences about what the study's protocol uses."""
    sentences = list(_ALL)
    if key.protocol != "rating":
        sentences += _SHARES
    if key.protocol in ("pairwise", "matched"):
        sentences += _VOTES
    if key.protocol in ("ranking", "rating"):
        sentences += _MEANS
    if key.protocol in ("pairwise", "ranking"):
        sentences += _STRENGTHS
    if key.protocol == "rating":
        sentences += _SLIDERS
    return sentences


_ALL = (
    "Votes of one participant are alike, so participants, not votes, are what chance draws.",
    f"p values are adjusted by Holm over the comparisons of one question; below {ALPHA:g} is "
    "called beyond chance. Questions are not adjusted for each other.",
)
_SHARES = (
    "A tie counts as half a vote for each side and as a vote in every total.",
    "Intervals of shares are Clopper-Pearson intervals at the effective number of votes (Korn and "
    "Graubard 1998), which the variance between participants gives. They speak of other "
    "participants on the same clips; “also over clips” of other clips, too (two-way clustered "
    f"variance; from {MIN_CLIPS} clips on), and takes clips as drawn at random. results.csv also "
    "has the plain Clopper-Pearson interval of decided votes, as if all votes were independent.",
)
_VOTES = (
    "Shares are tested by an exact binomial (sign) test over participants, each counted once for "
    "the side with more of their votes; who is even is not counted.",
)
_MEANS = (
    "Means are first taken over the clips of each participant, then compared by Friedman's test "
    "and, for pairs, Wilcoxon's signed-rank test over participants; their intervals come from "
    f"{RESAMPLES:,} bootstrap samples of participants.",
    "The power stated is that of the sign test; tests of means see somewhat more.",
)
_STRENGTHS = (
    "Bradley-Terry strengths have Davidson's ties and an advantage of the left side where sides "
    f"are seen, under a normal prior with standard deviation {PRIOR_SD:g} on every log-parameter. "
    "Rankings enter as the pairs that they imply. Intervals come from "
    f"{RESAMPLES:,} bootstrap samples of participants.",
)
_SLIDERS = (
    f"An attention check on a slider is passed within {SLIDER_TOLERANCE} of the number asked for.",
)
