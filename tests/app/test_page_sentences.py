"""What a page says of an error or a run names no option of the command line."""

import pytest

from app.errors import RunError, visitor_sentence


@pytest.mark.parametrize(
    ("told", "on_page"),
    [
        (
            "a.npy tells no frame rate; 30 was taken (say another with --fps).",
            "a.npy tells no frame rate; 30 was taken.",
        ),
        ("None was given: add it (--speech), or not.", "None was given: add it, or not."),
        ("It is longer than the limit (--max-minutes).", "It is longer than the limit."),
        ("Rates are 12 to 240 (30 usually).", "Rates are 12 to 240 (30 usually)."),
    ],
)
def test_what_is_for_the_command_line_is_left_out(told: str, on_page: str) -> None:
    assert visitor_sentence(RunError(told)) == on_page
