"""A little MathML: just enough for the equations of the page, made of nested calls."""

from __future__ import annotations

from html import escape

MINUS = "\N{MINUS SIGN}"
LOSS = "\N{SCRIPT CAPITAL L}"
BONES = "\N{SCRIPT CAPITAL B}"
PRIME = "\N{PRIME}"


def math(*parts: str) -> str:
    """A displayed formula."""
    return f'<math display="block">{row(*parts)}</math>'


def row(*parts: str) -> str:
    return f"<mrow>{''.join(parts)}</mrow>"


def var(name: str) -> str:
    """A variable or any other letter."""
    return f"<mi>{escape(name)}</mi>"


def word(name: str) -> str:
    """An upright word, such as an index that is no variable."""
    return f"<mtext>{escape(name)}</mtext>"


def op(sign: str) -> str:
    """An operator or a bracket, which does not grow with what it holds."""
    return f'<mo stretchy="false">{escape(sign)}</mo>'


def num(digits: str) -> str:
    return f"<mn>{escape(digits)}</mn>"


def sub(base: str, index: str) -> str:
    return f"<msub>{base}{index}</msub>"


def sup(base: str, power: str) -> str:
    return f"<msup>{base}{power}</msup>"


def subsup(base: str, index: str, power: str) -> str:
    return f"<msubsup>{base}{index}{power}</msubsup>"


def hat(base: str) -> str:
    return f'<mover accent="true">{base}<mo>^</mo></mover>'


def tilde(base: str) -> str:
    return f'<mover accent="true">{base}<mo>~</mo></mover>'


def frac(above: str, below: str) -> str:
    return f"<mfrac>{above}{below}</mfrac>"


def total(below: str) -> str:
    """A sum sign with what it runs over."""
    return f"<munder><mo>∑</mo>{below}</munder>"


def squared_norm(inside: str) -> str:
    return row(op("‖"), inside, sup(op("‖"), num("2")))
