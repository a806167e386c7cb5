"""What the documents say holds together: links, commands, lengths, and the card's numbers."""

import re
import shlex
import subprocess
from pathlib import Path

from app.commands.cli import parse
from model.metrics.protocols.table import HEADINGS, PROTOCOLS, protocol_row
from model.plan.kinds import USUAL_STROKE_GOALS
from tests.helpers import ROOT

DOCUMENTS = sorted(
    [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), *(ROOT / "examples").rglob("*.md")]
)
FENCE = re.compile(r"^```.*?^```$", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\]\(([^)\s]+)\)")
TABLES = ROOT / "docs" / "experiments" / "evaluation-tables.md"


def name_of(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def tables_of(path: Path) -> list[list[list[str]]]:
    """The tables of a document, each a list of rows of cells, without the line of dashes."""
    found = re.findall(r"(?:^\|.*\n)+", path.read_text("utf-8"), re.MULTILINE)
    rows = [[line.strip("|").split("|") for line in table.splitlines()] for table in found]
    return [[[cell.strip() for cell in row] for row in [table[0], *table[2:]]] for table in rows]


def anchors_of(path: Path) -> set[str]:
    """Return the anchors that GitHub makes of a document's headings."""
    headings = re.findall(r"^#+ (.*)$", FENCE.sub("", path.read_text("utf-8")), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", heading.lower()).replace(" ", "-") for heading in headings}


def commands_of(path: Path) -> list[str]:
    """Lines of a document's code that run the app."""
    code = "\n".join(FENCE.findall(path.read_text("utf-8")))
    return re.findall(r"^python -m app (.*)$", code, re.MULTILINE)


COMMANDS = [(name_of(path), line) for path in DOCUMENTS for line in commands_of(path)]


def test_what_documents_link_to_is_there_and_every_one_is_in_an_index():
    for path in DOCUMENTS:
        links = LINK.findall(FENCE.sub("", path.read_text("utf-8")))
        for target, _, anchor in (link.partition("#") for link in links if "://" not in link):
            linked = path.parent / target if target else path
            assert linked.exists(), (name_of(path), target)
            assert not anchor or anchor in anchors_of(linked), (name_of(path), target, anchor)
    for folder in (ROOT / "docs", ROOT / "docs" / "experiments"):
        linked = set(LINK.findall((folder / "README.md").read_text("utf-8")))
        assert {path.name for path in folder.glob("*.md")} - {"README.md"} <= linked


def test_commands_that_documents_show_are_taken_and_the_readme_leads_to_all():
    for document, line in COMMANDS:
        words = line.replace("[", " ").replace("]", " ").split(" > ")[0]
        assert callable(parse(shlex.split(words, comments=True))), (document, line)
    shown = {line.split()[0] for document, line in COMMANDS if document == "README.md"}
    assert shown >= {"generate", "diagnose", "render", "speech-effect", "plan", "study", "doctor"}
    assert len(COMMANDS) >= 25


def test_model_card_repeats_the_means_of_the_experiment():
    (head, *rows), *others = [
        table for table in tables_of(ROOT / "MODEL_CARD.md") if "FGD" in table[0]
    ]
    assert not others
    told: dict[str, dict[str, str]] = {}
    for measures, *systems in tables_of(TABLES):
        for system, *cells in systems:
            means = [cell.split(" ")[0] for cell in cells]
            told.setdefault(system, {}).update(zip(measures[1:], means, strict=True))
    assert {row[0]: dict(zip(head[1:], row[1:], strict=True)) for row in rows} == told


def test_the_table_of_protocols_is_that_of_the_records():
    tables = tables_of(ROOT / "docs" / "evaluation.md")
    (rows,) = ([[cell.strip("`") for cell in row] for row in t] for t in tables if t[0][0] == "id")
    assert rows == [list(HEADINGS), *(list(protocol_row(each)) for each in PROTOCOLS.values())]


def test_the_plans_page_lists_every_gesture_form():
    text = (ROOT / "docs" / "plans.md").read_text("utf-8")
    count, forms = re.search(
        r"corpus's (\d+) gesture forms.*?The forms:([^.]*)\.", text, re.S
    ).groups()
    assert re.findall(r"`(\w+)`", forms) == list(USUAL_STROKE_GOALS) and int(count) == len(
        USUAL_STROKE_GOALS
    )


def test_the_readme_lists_every_room():
    layout = (ROOT / "README.md").read_text("utf-8").split("## Layout")[1].split("```")[1]
    listed, top = [], ""
    for line in layout.strip().splitlines():
        is_room = line.startswith(" ")
        listed.append(f"{top}{line.split()[0]}" if is_room else line.split()[0])
        top = top if is_room else line.split()[0]
    told = subprocess.check_output(["git", "ls-files"], cwd=ROOT, text=True)
    folders = {f"{folder}/" for folder in re.findall(r"^(\w+)/", told, re.MULTILINE)}
    rooms = set(re.findall(r"^((?:app|model|renderer|tools)/\w+/)", told, re.MULTILINE))
    assert set(listed) == folders | rooms
