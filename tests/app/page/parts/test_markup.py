from app.page.parts import markup


def test_names_from_outside_cannot_bring_markup() -> None:
    evil = "<script>alert(1)</script>"
    pieces = [
        markup.header(evil),
        markup.status(evil, {"motion": 0.5}, {"motion": evil}),
        markup.error_message(evil),
        markup.notes_message([evil]),
    ]
    for piece in pieces:
        assert "<script" not in piece and "&lt;script" in piece


def test_stages_are_done_doing_or_still_to_do() -> None:
    html = markup.status("line", {"speech": 1.0, "motion": 0.4}, {"motion": "globaldiff/local"})
    assert html.count('class="done"') == 1
    assert html.count('class="doing"') == 1
    assert html.count('class="todo"') == 4
    assert "40 %" in html and "globaldiff/local" in html


def test_nothing_to_say_takes_no_room() -> None:
    assert markup.notes_message([]) == ""
