from pathlib import Path

from app.page.results.result_parts import FiguresShown
from app.page.routes.media import MediaAddresses
from app.run.requests.request import Artefact
from app.text import FIGURES
from tests.app.fakes import measures
from tests.app.measured import diagnostics_of


def shown(tmp_path: Path, *files: str) -> FiguresShown:
    figures = FiguresShown(MediaAddresses(), "")
    for file in files:
        path = tmp_path / file
        path.touch()
        figures.take(Artefact("figure", path.stem, path))
    return figures


def test_a_figure_is_shown_once_its_picture_is_there_with_all_its_files(tmp_path: Path) -> None:
    assert shown(tmp_path, "figure6.svg").html() == ""
    html = shown(tmp_path, "figure6.svg", "figure6.png", "jitter.png").html()
    assert html.count("<img") == 2
    assert html.count("download=") == 3 and 'download="figure6.svg"' in html
    assert html.index(FIGURES["figure6"].title) < html.index(FIGURES["jitter"].title)


def test_sentences_come_with_the_numbers_and_are_theirs(tmp_path: Path) -> None:
    figures = shown(tmp_path, "figure6.png")

    def sentence(local: float, other: float) -> str:
        systems = {"local": measures(local), "global": measures(other)}
        return figures.html(diagnostics_of(**systems))

    assert "figcaption><p class" in figures.html()
    assert "local has 3.0 times" in sentence(300.0, 100.0)
    assert "global has 3.0 times" in sentence(100.0, 300.0)


def test_other_files_are_no_figures(tmp_path: Path) -> None:
    figures = FiguresShown(MediaAddresses(), "")
    figures.take(Artefact("diagnostics", "diagnostics", tmp_path / "diagnostics.png"))
    assert figures.html() == ""
