from app import view
from tests.app.fakes import measures


def test_names_from_outside_cannot_bring_markup() -> None:
    evil = "<script>alert(1)</script>"
    pieces = [
        view.header(evil),
        view.status(evil, {"motion": 0.5}, {"motion": evil}),
        view.error_message(evil),
        view.notes_message([evil]),
        view.pending([evil]),
        view.numbers_table({"systems": {evil: measures(1.0)}, "reference": None}),
    ]
    for piece in pieces:
        assert "<script" not in piece and "&lt;script" in piece


def test_stages_are_done_doing_or_still_to_do() -> None:
    html = view.status("line", {"speech": 1.0, "motion": 0.4}, {"motion": "globaldiff/local"})
    assert html.count('class="done"') == 1
    assert html.count('class="doing"') == 1
    assert html.count('class="todo"') == 4
    assert "40 %" in html and "globaldiff/local" in html


def test_the_table_shows_raw_and_filtered_numbers_and_the_reference_last() -> None:
    table = view.numbers_table(
        {"tip": "right_middle", "systems": {"a": measures(300.0)}, "reference": measures(90.0)}
    )
    assert "<td>300<small>100</small></td>" in table
    assert "1.23 %" in table
    assert table.index(">a<") < table.index(">reference<")
    assert "<td>90<small>30</small></td>" in table


def test_a_measure_that_a_short_clip_cannot_have_is_no_number() -> None:
    broken = measures(1.0)
    broken["raw"]["seam_jerk_ratio"] = None
    assert "<td>n/a<small>" in view.numbers_table({"systems": {"a": broken}, "reference": None})


def test_nothing_to_say_takes_no_room() -> None:
    assert view.notes_message([]) == "" and view.pending([]) == ""
