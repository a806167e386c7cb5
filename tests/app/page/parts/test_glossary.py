"""Words that explain themselves."""

from html.parser import HTMLParser

import pytest

from app import text
from app.page.parts.markup import WORDS, explained


class Read(HTMLParser):
    """The text of HTML, and its titles."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.text, self.titles = "", []
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        assert tag == "abbr"
        self.titles += [value for name, value in attrs if name == "title"]

    def handle_data(self, data: str) -> None:
        self.text += data


def test_a_word_is_explained_where_it_stands_first() -> None:
    read = Read(explained("Jerk by depth: jerk and jerky <b>."))
    assert read.text == "Jerk by depth: jerk and jerky <b>."
    assert read.titles == [WORDS["jerk"], WORDS["depth"]]
    assert explained("jerk") == f'<abbr title="{WORDS["jerk"]}">jerk</abbr>'


@pytest.mark.parametrize("figure", text.FIGURES.values(), ids=text.FIGURES)
def test_what_stands_by_figures_stays_as_it_was(figure: text.FigureText) -> None:
    assert Read(explained(figure.help)).text == figure.help


def test_two_words_with_one_meaning_are_explained_once() -> None:
    assert Read(explained("A seam beside other seams.")).titles == [WORDS["seam"]]
