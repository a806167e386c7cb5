"""Entries of a leaderboard: taken in, put together, refused."""

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.commands.cli import main
from app.errors import RunError
from app.findings.metric_table import format_three_digits
from app.run.batch.leaderboard import (
    LeaderboardEntry,
    MetricValue,
    entries_from_results,
    leaderboard_page_html,
    merge_entries,
    read_leaderboard,
    write_leaderboard,
)
from app.run.batch.motion_sets import diagnose_folders
from app.run.batch.table import worst_clips
from model.motion.motion import save_motion
from tests.app.requests import diagnose_request
from tests.helpers import smooth_motion_example


def entry(**changes: Any) -> LeaderboardEntry:
    told = LeaderboardEntry(
        "ours", "a test", "f" * 64, 2, "2026-01-02T00:00:00+00:00", "abc",
        {"joint_jerk_m_s3": MetricValue(3.0, 2.0, 4.0, "m/s³", 2)}, {"jerk": 1}, "first",
    )  # fmt: skip
    return replace(told, **changes)


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two systems on two clips beside recorded ones, and the first alone on the same."""
    root = tmp_path_factory.mktemp("sets")
    for place, name in enumerate(("calm", "other", "recorded")):
        (root / name).mkdir()
        for clip in range(2):
            motion = smooth_motion_example(70, seed=10 * place + clip)
            save_motion(motion, root / name / f"clip{clip}.npz")
    recorded = root / "recorded"
    both = (root / "calm", root / "other")
    diagnose_folders(diagnose_request(motions=both, out=root / "both", reference=recorded))
    diagnose_folders(diagnose_request(motions=both[:1], out=root / "one", reference=recorded))
    return root


def test_the_same_clips_measured_again_are_the_same_test(measured: Path) -> None:
    board = entries_from_results(measured / "both", "a note")
    assert [each.system for each in board] == ["calm", "other", "reference"]
    assert len({each.test_id for each in board}) == 1 and board[2].note == ""
    assert board[0].measures["joint_jerk_m_s3"].num_clips == 2
    again = entries_from_results(measured / "one")
    put = merge_entries([board, again])
    notes = [("calm", "a note"), ("other", "a note"), ("reference", "")]
    assert [(one.system, one.note) for one in put] == notes
    chosen = entries_from_results(measured / "both", systems=["other"])
    assert [one.system for one in chosen] == ["other", "reference"]


def test_another_recorded_clip_is_another_test(measured: Path, tmp_path: Path) -> None:
    (tmp_path / "recorded").mkdir()
    for clip in range(2):
        save_motion(smooth_motion_example(70, seed=clip), tmp_path / "recorded" / f"clip{clip}.npz")
    motions, reference = (measured / "calm",), tmp_path / "recorded"
    diagnose_folders(diagnose_request(motions=motions, out=tmp_path / "out", reference=reference))
    (calm, _) = entries_from_results(tmp_path / "out")
    (known, *_) = entries_from_results(measured / "one")
    assert calm.test_id != known.test_id and calm.files_digest == known.files_digest


def test_the_latest_measurement_wins_and_a_note_stays() -> None:
    old, new = entry(), entry(measured_at="2026-02-01T00:00:00+00:00", note="", num_clips=3)
    assert (
        merge_entries([[new], [old]])
        == merge_entries([[old], [new]])
        == [replace(new, note="first")]
    )
    other = entry(files_digest="e" * 64)
    assert len(merge_entries([[old, other]])) == 2


def test_a_board_comes_back_as_it_was_and_what_is_none_is_refused(tmp_path: Path) -> None:
    write_leaderboard([entry()], tmp_path / "board.json")
    assert read_leaderboard(tmp_path / "board.json") == [entry()]
    told = json.loads((tmp_path / "board.json").read_text())
    (one,) = told["entries"]
    assert one["made_at"] == entry().measured_at, "the key of all boards so far"
    measure = {"joint_jerk_m_s3": {**one["measures"]["joint_jerk_m_s3"], "mean": "1"}}
    for change, words in (
        ({"format": 9}, "`format` cannot be 9"),
        ({"entries": {}}, "`entries` cannot be"),
        *(
            ({"entries": [entry]}, r"`entries\.0\.")
            for entry in (
                *({"system": "x"}, {**one, "clips": "2"}, {**one, "clips": True}),
                *({**one, "note": 3}, {**one, "measures": measure}),
            )
        ),
    ):
        (tmp_path / "board.json").write_text(json.dumps({**told, **change}))
        with pytest.raises(RunError, match=f"as a leaderboard .*{words}"):
            read_leaderboard(tmp_path / "board.json")


def test_results_without_a_recorded_set_are_refused(measured: Path, tmp_path: Path) -> None:
    diagnose_folders(diagnose_request(motions=(measured / "calm",), out=tmp_path / "alone"))
    with pytest.raises(RunError, match="without a recorded set"):
        entries_from_results(tmp_path / "alone")
    with pytest.raises(RunError, match=r"no system 'nobody'; it has calm"):
        entries_from_results(measured / "one", systems=["nobody"])
    with pytest.raises(RunError, match="could not be read"):
        entries_from_results(tmp_path)


def test_results_with_their_former_name_are_read(measured: Path, tmp_path: Path) -> None:
    shutil.copy(measured / "one" / "batch.json", tmp_path / "many.json")
    assert [each.key for each in entries_from_results(tmp_path)] == [
        each.key for each in entries_from_results(measured / "one")
    ]


def test_results_of_another_version_are_refused_with_a_sentence(measured, tmp_path):
    whole = json.loads((measured / "one" / "batch.json").read_text())
    where = whole["provenance"]
    row = {**whole["measures"][0], "mean": "1"}
    for told in (
        *({key: value for key, value in whole.items() if key != left} for left in whole),
        *(
            {**whole, "provenance": {key: value for key, value in where.items() if key != left}}
            for left in where
        ),
        *({**whole, "provenance": wrong} for wrong in (None, [], "x")),
        *([], {**whole, "measures": [row]}, {**whole, "measures": [{}]}),
    ):
        (tmp_path / "batch.json").write_text(json.dumps(told))
        try:
            entries_from_results(tmp_path)
        except RunError as error:
            assert "another version of this program; measure the set again" in str(error)
        else:
            assert isinstance(told, dict)
            assert {*whole} - {*told} <= {"left_out", "notes", "worst"}, told.keys()


def test_the_command_keeps_merges_and_shows(measured: Path, tmp_path: Path) -> None:
    first, second, put = (str(tmp_path / f"{name}.json") for name in ("a", "b", "c"))
    assert main(["leaderboard", "add", first, str(measured / "both"), "--note", "x <b> y"]) == 0
    assert main(["leaderboard", "add", second, str(measured / "one")]) == 0
    assert main(["leaderboard", "merge", first, second, "--out", put]) == 0
    page = tmp_path / "board.html"
    assert main(["leaderboard", "page", put, "--out", str(page)]) == 0
    html = page.read_text()
    assert html.count("<tr") == 4 and "x &lt;b&gt; y" in html and "x <b> y" not in html
    assert main(["leaderboard", "page", put, "--out", str(tmp_path / "board.txt")]) == 1


def test_values_say_how_far_they_are_from_recorded() -> None:
    """What the page sorts by."""
    recorded = entry(system="reference", measures={"joint_jerk_m_s3": MetricValue(5, 5, 5, "", 2)})
    fgd = {"fgd": MetricValue(7, 6, 8, "", 2)}
    html = leaderboard_page_html([entry(measures={**entry().measures, **fgd}), recorded])
    apart = [float(cell.split('"')[0]) for cell in html.split('data-apart="')[1:]]
    assert np.allclose(apart, [2.0, 7.0, 0.0])


def test_beat_align_stands_on_a_board_with_its_chance_level_or_not_at_all() -> None:
    beats, chance = "beat_align", "beat_align_chance"
    value = MetricValue(0.4, 0.4, 0.4, "0 to 1", 1)
    recorded = entry(system="reference", measures={beats: value, chance: value})
    alone = leaderboard_page_html([entry(measures={beats: value}), recorded])
    assert alone.count("0.4") - alone.count('"0.4"') == 2  # the recorded motion's two
    both = leaderboard_page_html([entry(measures={beats: value, chance: value}), recorded])
    heads = [head for head in both.split("<tbody")[0].split("<th") if "BeatAlign" in head]
    assert len(heads) == 2 and not any('class="rare"' in head for head in heads)
    assert both.split("</table>")[1].count("<dt>Beat alignment: BeatAlign") == 2  # their rules
    assert both.count("data-apart") == 2  # to be near in the level of chance says nothing
    assert "[0.4, 0.4]" not in both  # one clip has no interval


def test_errors_are_nearer_to_recorded_motion_the_smaller_they_are() -> None:
    key = "pelvis_error_cm"
    small, large = (
        entry(system=name, measures={key: MetricValue(of, of, of, "cm", 1)})
        for name, of in (("a", 2.0), ("b", 5.0))
    )
    html = leaderboard_page_html([small, large])
    assert [cell.split('"')[0] for cell in html.split('data-apart="')[1:]] == ["2", "5"]


def test_a_clip_without_jerk_to_compare_is_told_without_it() -> None:
    """Not as 0 m/s³, which nobody measured."""
    (clip,) = worst_clips({"a": [("one", {"numbers": {}, "findings": ["pops"]})]})
    assert clip["jerk"] is None and format_three_digits(clip["jerk"]) == "n/a"
