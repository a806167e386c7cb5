"""The findings of all motions in the order in which a person wants to know of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from model.faults.evidence import Finding

GRAVEST = 3


def told_findings(findings: Mapping[str, Sequence[Finding]]) -> list[str]:
    """One line each: the gravest few under a heading of their own, the rest by gravity too."""
    from model.faults.evidence import ranked

    lines = [f"{name}: {finding.sentence}" for name, finding in ranked(findings)]
    if len(lines) <= GRAVEST:
        return lines
    return ["Gravest first:", *lines[:GRAVEST], "Also found:", *lines[GRAVEST:]]
