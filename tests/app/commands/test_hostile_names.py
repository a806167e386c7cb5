"""Runs over files, folders and systems with hostile names: what others open obeys none of them."""

import csv
import io
import os
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from pathlib import Path

import pytest

from app.commands.cli import main
from app.study.design.key import read_key
from app.study.design.plan import read_study_plan
from app.study.export import export_study
from model.motion.motion import save_motion
from tests.app.study.made_study import draw_noise, write_inputs
from tests.helpers import csv_rows, smooth_motion_example

FORMULA = "=cmd|' -C calc'!A0"
CUT = "-2+3;@SUM(1)"
TITLE = "\x1b]0;owned\x07\x1b[2J\nnext\u202e"
MARKUP = "]]>--><script>alert(1)<!--&amp;"
TEX = "\\input{secret} % & # _ $x$ ~^"
NO_TEXT = os.fsdecode(b"caf\xe9\xff")
NAMES = (FORMULA, CUT, TITLE + NO_TEXT, MARKUP + TEX)


def cells_of(path: Path) -> Iterator[str]:
    """As a spreadsheet finds them that cuts lines at commas, and as one that takes semicolons."""
    text = path.read_text("utf-8")
    for separator in ",;":
        for row in csv.reader(text.splitlines(), delimiter=separator):
            yield from row


def is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True


def check_folder(folder: Path) -> list[str]:
    """Look at every file that others open; returns the names of all."""
    names = []
    for path in sorted(path for path in folder.rglob("*") if path.is_file()):
        names.append(path.name)
        assert str(path.relative_to(folder)).isprintable()
        if path.suffix == ".csv":
            for cell in filter(None, cells_of(path)):
                begins = cell.lstrip(" ")[:1] in tuple("=+-@")
                first = cell.split(",")[0]  # the whole line, for who cuts at semicolons
                assert cell.isprintable() and (not begins or is_number(first)), cell
        elif path.suffix == ".svg":
            for element in ElementTree.parse(path).iter():
                assert not str(element.tag).lower().endswith("}script")
        if path.suffix in (".svg", ".md", ".tex", ".html", ".json"):
            text = path.read_text("utf-8").replace("\n", "").replace("\t", "")
            assert not any(char in text for char in "\x1b\x07\x9b\u202e"), path.name
            assert path.suffix == ".json" or "<script>" not in text, path.name
    return names


def run(argv: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """A command that must succeed; returns all that it said."""
    status = main(argv)
    said = "".join(capsys.readouterr())
    assert status == 0, said
    assert "\x1b" not in said and "\u202e" not in said
    return said


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True

    def check(self) -> None:
        """It has been sent nothing that it would obey, but that bars move up."""
        shown = self.getvalue()
        for allowed in ("\x1b[A", "\r", "\n"):
            shown = shown.replace(allowed, "")
        assert shown and all(char.isprintable() for char in shown), shown


def sit_at_terminal(monkeypatch: pytest.MonkeyPatch) -> Terminal:
    terminal = Terminal()
    for stream in ("sys.stdout", "sys.stderr"):
        monkeypatch.setattr(stream, terminal)
    return terminal


def test_diagnose_tells_of_files_with_hostile_names(tmp_path, monkeypatch):
    terminal = sit_at_terminal(monkeypatch)
    motions = [tmp_path / f"{name}.npz" for name in NAMES]
    for seed, path in enumerate(motions):
        save_motion(smooth_motion_example(12, seed), path)
    out = tmp_path / f"out{TITLE}{NO_TEXT}"
    assert main(["diagnose", *map(str, motions), "--out", str(out), "--no-poses"]) == 0
    terminal.check()
    assert {"figure6.svg", "jitter.svg"} <= {*check_folder(out)}
    rows = csv_rows(out / "diagnostics.csv")
    assert {f"'{FORMULA}", "'-2+3;'@SUM(1)", MARKUP + TEX} <= {row["name"] for row in rows}
    assert any(float(row["value"]) < 0 for row in rows)


def test_a_terminal_is_sent_no_control_characters_by_what_fails(tmp_path, monkeypatch):
    terminal = sit_at_terminal(monkeypatch)
    name = TITLE + NO_TEXT
    argv = ["diagnose", str(tmp_path / f"none{name}.npz"), "--out", str(tmp_path / name)]
    assert main(argv) == 1
    with pytest.raises(SystemExit):
        main([*argv, f"--{name}"])
    terminal.check()


def test_folders_with_hostile_names_are_held_beside_each_other(tmp_path, capsys):
    folders = [tmp_path / name for name in (FORMULA, TITLE, CUT)]
    for seed, folder in enumerate(folders):
        folder.mkdir()
        for clip in ("a", FORMULA, TITLE):
            save_motion(smooth_motion_example(30, seed), folder / f"{clip}.npz")
    out = tmp_path / "out"
    run(["diagnose", *map(str, folders), "--out", str(out), "--processes", "1"], capsys)
    assert {"batch.csv", "summary.md"} <= {*check_folder(out)}
    sheet = (out / "summary.md").read_text("utf-8").splitlines()
    (head,) = [line for line in sheet if line.startswith("| measure")]
    assert head.replace("\\|", "").count("|") == 5  # three systems, whatever they are called


def test_a_study_of_systems_with_hostile_names_goes_from_plan_to_report(tmp_path, capsys):
    names = ("@SUM(1)*cmd|' /C calc'!A0", "-2+3;@SUM(1)", MARKUP, TEX)
    clips = ("+1", "\\input{x}")
    files = [f"system{number}" for number in range(len(names))]
    write_inputs(tmp_path, files, ["clip0", "clip1"])
    lines = ["title = '=1+1<script>'", "protocol = 'pairwise'", "participants = 4", "size = 64"]
    for number, clip in enumerate(clips):
        lines += ["[[clips]]", f"name = '{clip}'", f"speech = 'clip{number}.wav'"]
    for name, file in zip(names, files, strict=True):
        table = ", ".join(f"'{clip}' = '{file}-clip{n}.npz'" for n, clip in enumerate(clips))
        lines += ["[[systems]]", f'name = """{name.replace(chr(92), chr(92) * 2)}"""']
        lines += [f"motion = {{{table}}}"]
    plan, study = tmp_path / "plan.toml", tmp_path / "study"
    plan.write_text("\n".join(lines))
    export_study(read_study_plan(plan), study, draw=draw_noise)
    key = study / "researcher_only" / "key.json"
    assert read_key(key).systems == names
    run(["study", "simulate", str(study), "--raters", "6", "--out", str(tmp_path / "answers"),
         "--strengths", ",".join(f"{name}={n}" for n, name in enumerate(names))],
        capsys)  # fmt: skip
    first, *others = sorted((tmp_path / "answers").glob("*.json"))
    first.rename(first.with_name(f"{TITLE}<script>.json"))
    others[0].with_name(f"{FORMULA}\x1b.json").write_text("{")
    run(["study", "analyse", str(tmp_path / "answers"), "--key", str(key), "--out",
         str(tmp_path / "report")], capsys)  # fmt: skip
    assert {"results.csv", "table.tex", "report.html"} <= {*check_folder(tmp_path / "report")}
    check_folder(study / "researcher_only")
    table = (tmp_path / "report" / "table.tex").read_text("utf-8")
    assert r"\textbackslash{}input\{secret\} \% \& \# \_ \$x\$" in table
    assert "\\input" not in table
    said = run(["study", "links", str(study), "--address", "https://lab.example/a=1;=1+1/"], capsys)
    (tmp_path / "links").mkdir()
    (tmp_path / "links" / "links.csv").write_text(said, "utf-8")
    check_folder(tmp_path / "links")
