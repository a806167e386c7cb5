"""The figure of sets: drawn from five clips on, of as many systems as can be told apart."""

from pathlib import Path

from app.findings.measure_rows import MEASURES
from app.run.many.table import LEAST_CLIPS, draw_spread
from conventions.names import REFERENCE_NAME


def numbers(clips: int, systems: list[str]) -> list[dict]:
    told = [row.key for row in MEASURES if not row.group.startswith("Beat")]
    return [
        {"systems": {name: {"numbers": dict.fromkeys(told, 1.0 + k)} for name in systems}}
        for k in range(clips)
    ]


def test_few_clips_have_no_figure(tmp_path: Path):
    systems = ["a", REFERENCE_NAME]
    assert draw_spread(tmp_path, systems, numbers(LEAST_CLIPS - 1, systems)) == ((), [])
    files, said = draw_spread(tmp_path, systems, numbers(LEAST_CLIPS, systems))
    assert [path.name for path in files] == [
        f"distributions.{e}" for e in ("png", "svg", "pdf", "txt")
    ]
    assert all(path.is_file() for path in files) and not said
    text = (tmp_path / "distributions.svg").read_text()
    assert "Slide on the ground" in text and "BeatAlign" not in text


def test_systems_beyond_the_styles_are_named(tmp_path: Path):
    systems = [f"system {k}" for k in range(12)] + [REFERENCE_NAME]
    files, said = draw_spread(tmp_path, systems, numbers(LEAST_CLIPS, systems))
    assert files and "system 11" in said[0]
