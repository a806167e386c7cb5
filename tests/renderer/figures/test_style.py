"""Styles differ without colour, and measured text loses nothing."""

from renderer.figures.style import REFERENCE_STYLE, SYSTEM_STYLES, wrap_text


def test_styles_differ_without_colour() -> None:
    styles = [REFERENCE_STYLE, *SYSTEM_STYLES]

    assert len({style.dashes for style in styles}) == len(styles)
    assert len({style.marker for style in styles}) == len(styles)
    assert [style for style in styles if not style.dashes] == [REFERENCE_STYLE]


def test_wrapped_text_loses_nothing() -> None:
    text = "a/" + "b" * 90 + "-c_d " + "e" * 5
    for width in (0.05, 0.5, 2.0, 50.0):
        lines = wrap_text(text, 7.0, width, breaks_after="/-_ ")
        assert "".join(lines).replace(" ", "") == text.replace(" ", "")
