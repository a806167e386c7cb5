"""What the documents say holds together: links, commands, lengths, and the card's numbers."""

import re
import shlex
from pathlib import Path

from app.commands.cli import parse
from tests.helpers import ROOT

DOCUMENTS = sorted(
    [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), *(ROOT / "examples").rglob("*.md")]
)
FENCE = re.compile(r"^```.*?^```$", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\]\(([^)\s]+)\)")
TABLES = ROOT / "docs" / "experiments" / "evaluation-tables.md"


MAIN_MEASURES = {
    "FGD": "FGD",
    "FMD": "FMD",
    "arms by speech": "arm speed decided by speech",
    "arms, same noise": "same noise, other speech: arm speed",
    "judge": "matched, share right",
    "wrists, right less foreign": "right minus foreign",
    "in silence": "arm speed in silence over speaking",
    "tip jerk": "tip jerk, m/s^3 of recorded",
    "tip path": "tip path, m/s of recorded",
    "power > 5 Hz": "power > 5 Hz of recorded",
    "foot slide": "foot slide, m/s of recorded",
    "ankle jerk": "ankle jerk, m/s^3 of recorded",
}


def name_of(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def tables_of(path: Path) -> list[list[list[str]]]:
    """The tables of a document, each a list of rows of cells, without the line of dashes."""
    found = re.findall(r"(?:^\|.*\n)+", path.read_text("utf-8"), re.MULTILINE)
    rows = [[line.strip("|").split("|") for line in table.splitlines()] for table in found]
    return [[[cell.strip() for cell in row] for row in [table[0], *table[2:]]] for table in rows]


def commands_of(path: Path) -> list[str]:
    """Lines of a document's code that run the app."""
    code = "\n".join(FENCE.findall(path.read_text("utf-8")))
    return re.findall(r"^python -m app (.*)$", code, re.MULTILINE)


COMMANDS = [(name_of(path), line) for path in DOCUMENTS for line in commands_of(path)]


def the_long_tables() -> dict[str, dict[str, str]]:
    """System to measure to mean, of the long tables."""
    means: dict[str, dict[str, str]] = {}
    for head, *rows in tables_of(TABLES):
        if head[0] == "20 test clips":
            for measure, *cells in rows:
                for system, cell in zip(head[1:], cells, strict=True):
                    means.setdefault(system, {}).setdefault(measure, cell.split(" ")[0])
        elif head[-1] == "right minus foreign":
            for system, *cells in rows:
                means[system][head[-1]] = cells[-1].split(" ")[0]
    return means


def test_what_documents_link_to_is_there_and_every_one_is_in_an_index():
    for path in DOCUMENTS:
        links = LINK.findall(FENCE.sub("", path.read_text("utf-8")))
        targets = [link.split("#")[0] for link in links if "://" not in link]
        missing = [target for target in targets if target and not (path.parent / target).exists()]
        assert not missing, name_of(path)
    for folder in (ROOT / "docs", ROOT / "docs" / "experiments"):
        linked = set(LINK.findall((folder / "README.md").read_text("utf-8")))
        assert {path.name for path in folder.glob("*.md")} - {"README.md"} <= linked


def test_commands_that_documents_show_are_taken_and_the_readme_leads_to_all():
    for document, line in COMMANDS:
        words = line.replace("[", " ").replace("]", " ").split(" > ")[0]
        assert callable(parse(shlex.split(words, comments=True))), (document, line)
    shown = {line.split()[0] for document, line in COMMANDS if document == "README.md"}
    assert shown >= {"generate", "diagnose", "render", "hearing", "plan", "study", "doctor"}
    assert len(COMMANDS) >= 25


def test_model_card_repeats_the_long_tables():
    tables = tables_of(ROOT / "MODEL_CARD.md")
    (head, *rows), *others = [table for table in tables if "FGD" in table[0]]
    assert not others
    assert set(head[1:]) == set(MAIN_MEASURES)
    means = the_long_tables()
    assert {row[0].strip("`") for row in rows} == set(means)
    for system, *cells in rows:
        expected = [means[system.strip("`")][MAIN_MEASURES[column]] for column in head[1:]]
        assert cells == expected, system
