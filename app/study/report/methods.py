"""How the report's numbers were computed, told to its reader."""

from __future__ import annotations

from app.study.design.key import Key
from app.study.statistics.bradley_terry import PRIOR_SD
from app.study.statistics.power import ALPHA
from app.study.statistics.preference import MIN_CLIPS
from app.study.statistics.resampling import RESAMPLES
from app.study.statistics.screening import SLIDER_TOLERANCE


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
