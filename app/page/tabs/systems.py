"""The ladder of systems explained in one screen: what each adds, its equation, what to look for.

Equations are those of GlobalDiff; their numbers are the paper's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

from app.page.parts.mathml import (
    BONES,
    LOSS,
    MINUS,
    PRIME,
    frac,
    hat,
    math,
    num,
    op,
    row,
    squared_norm,
    sub,
    subsup,
    sup,
    tilde,
    total,
    var,
    word,
)
from model.systems.globaldiff.config import BEST

TITLE = "Five systems, each adding one thing to the one before"
INTRODUCTION = (
    "All predict the clean motion from a noised one, the speech, the speaker and a short seed "
    "(flow matching, eq. 7), with positions supervised beside rotations. In this project everything"
    " but the rung's own step is equal: data and their order, network, windows of training, and "
    "the noise of a comparison; each was trained from nothing, on raw rotations as in the paper's "
    "code. That a step helps is the paper's claim; on your clip, the measures decide."
)
NOT_HERE = "no weights here"
OWN_TITLE = "And one of our own, made to move well"
OWN_MEANING = (
    "Before any network, a linear-Gaussian model of the motion (how far, how smoothly and how long "
    "each part of the body moves) says what x₁ can be, given the noised motion and the frames "
    "before. The network adds to that what speech tells, in units of what is still open. So it "
    "moves as far and as smoothly as its data; the ladder shows what happens without."
)


@dataclass(frozen=True)
class Rung:
    """One row of the paper's Table 2."""

    system: str
    adds: str
    meaning: str
    equation: str
    source: str
    look_for: str


_LOCAL = math(
    subsup(var("R"), var("k"), word("global")), op("="),
    subsup(var("R"), num("1"), word("local")), subsup(var("R"), num("2"), word("local")),
    op("⋯"), subsup(var("R"), var("k"), word("local")),
)  # fmt: skip
_GLOBAL = math(
    sub(var("q"), var("k")), op("="), sub(var("q"), word("root")), op("+"),
    total(row(op("("), var("i"), op("→"), var("j"), op(")"), op("∈"), var("π"), op("("), var("k"),
              op(")"))),
    subsup(var("R"), var("i"), word("global")),
    row(op("("), sub(var("t"), var("j")), op(MINUS), sub(var("t"), var("i")), op(")")),
)  # fmt: skip
_JOINT = math(
    sub(var(LOSS), var("j")), op("="), frac(num("1"), row(var("K"), var("N"))),
    total(row(var("k"), op(","), var("n"))),
    squared_norm(row(
        subsup(var("R"), var("k"), word("global")), subsup(var("v"), var("k"), var("n")), op(MINUS),
        subsup(var("R"), var("k"), word("gt")), subsup(var("v"), var("k"), var("n")),
    )),
)  # fmt: skip
_OTHER_BONE = row(var("b"), op(PRIME))
_SKELETON = math(
    sub(var(LOSS), var("s")), op("="), frac(num("1"), row(op("|"), var(BONES), op("|"))),
    total(row(var("b"), op(","), _OTHER_BONE, op("∈"), var(BONES))),
    sup(row(
        op("("), sup(var("b"), word("T")), _OTHER_BONE, op(MINUS),
        sup(tilde(var("b")), word("T")), row(tilde(var("b")), op(PRIME)), op(")"),
    ), num("2")),
)  # fmt: skip
_MOTION = math(
    sub(var(LOSS), var("m")), op("="),
    squared_norm(row(var("g"), op("("), hat(var("X")), op(")"), op(MINUS), var("g"), op("("),
                     var("X"), op(")"))),
)  # fmt: skip

RUNGS = (
    Rung(
        "globaldiff/local", "Local rotations",
        "Each joint is predicted relative to its parent. A joint's direction in the world is a "
        "product along the chain, so an error at the shoulder turns everything below it.",
        _LOCAL, "eq. 3",
        "Trembling that grows from shoulder to fingertip; a body that tilts as a whole.",
    ),
    Rung(
        "globaldiff/global", "Global rotations",
        "Each joint is predicted in the world. A position is a sum over the chain's bones; an "
        "error at one joint moves what is below it but turns nothing else.",
        _GLOBAL, "eq. 5",
        "A quieter fingertip. The price: nothing ties neighbours together, so single joints may "
        "twist against their parents.",
    ),
    Rung(
        "globaldiff/joint", "+ joint constraint",
        "Six anchor points around each joint are turned along with it and compared. A position "
        "says nothing of a last joint's own turn; the anchors do.",
        _JOINT, "eqs. 8 to 10",
        "Thumbs and little fingers: without it they may be flipped or twisted.",
    ),
    Rung(
        "globaldiff/skeleton", "+ skeleton constraint",
        "The angle between every two bones is compared, however far apart they are on the body.",
        _SKELETON, "eqs. 11 to 13",
        "Posture: leaning, uneven limbs and unsteady feet should become rarer.",
    ),
    Rung(
        "globaldiff/full", "+ motion constraint",
        "A trained encoder g turns whole stretches of motion into codes at several time scales; "
        "codes of prediction and recording are compared.",
        _MOTION, "eqs. 14 and 15",
        "Timing: rhythm and dynamics over seconds, which no single frame shows.",
    ),
)  # fmt: skip


def ladder(systems: Sequence[str]) -> str:
    """The rungs as cards from left to right, with what cannot be run here marked as such."""
    cards = "".join(_card(number, rung, systems) for number, rung in enumerate(RUNGS, start=1))
    return (
        f'<section class="ladder"><h2>{escape(TITLE)}</h2><p>{escape(INTRODUCTION)}</p>'
        f"<ol>{cards}</ol>{_own(systems)}</section>"
    )


def _own(systems: Sequence[str]) -> str:
    missing = "" if BEST in systems else f"<em>{NOT_HERE}</em>"
    return (
        f'<div class="own"><h3>{escape(OWN_TITLE)}</h3><code>{escape(BEST)}</code>{missing}'
        f"<p>{escape(OWN_MEANING)}</p></div>"
    )


def _card(number: int, rung: Rung, systems: Sequence[str]) -> str:
    is_here = rung.system in systems
    missing = "" if is_here else f"<em>{NOT_HERE}</em>"
    return (
        f'<li{"" if is_here else " class=absent"}><h3><i aria-hidden="true">{number}</i>'
        f"{escape(rung.adds)}</h3>"
        f"<code>{escape(rung.system)}</code>{missing}<p>{escape(rung.meaning)}</p>"
        f'<div class="equation">{rung.equation}<small>{escape(rung.source)}</small></div>'
        f"<p><b>Look for</b> {escape(rung.look_for)}</p></li>"
    )
