import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.errors import RunError
from app.study.statistics.jitter_join import join_jitter, read_jitter
from app.study.statistics.votes import Votes, joined
from tests.app.study.made import made_votes

CLIPS = ("a", "b", "c", "d")
SYSTEMS = ("smooth", "rough", "reference")


def diagnostics(smooth: float | None, rough: float, reference: float | None = None) -> dict:
    def measures(jerk: float | None) -> dict[str, Any]:
        return {"raw": {"tip_jerk_m_s3": jerk}, "savgol": {"tip_jerk_m_s3": 1.0}}

    return {
        "systems": {"smooth": measures(smooth), "rough": measures(rough)},
        "reference": None if reference is None else measures(reference),
    }


def votes_on(clip: int, *rows: tuple[int, int, int, float], because: bool = False) -> Votes:
    votes = made_votes(list(rows), clip)
    votes.because_smooth[:] = because
    return votes


def test_jerk_is_read_from_both_places_and_the_recording_by_its_name(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "diagnostics.json").write_text(json.dumps(diagnostics(10, 30, 5)))
    (tmp_path / "b.json").write_text(json.dumps(diagnostics(None, 40)))
    assert read_jitter(tmp_path, CLIPS, SYSTEMS) == {
        ("a", "smooth"): 10,
        ("a", "rough"): 30,
        ("a", "reference"): 5,
        ("b", "rough"): 40,
    }


def test_nothing_measured_and_damage_are_errors(tmp_path: Path) -> None:
    with pytest.raises(RunError, match=r"expected a/diagnostics.json or a.json there"):
        read_jitter(tmp_path, CLIPS, SYSTEMS)
    (tmp_path / "a.json").write_text('{"systems": {"smooth": {"raw": 3}}}')
    with pytest.raises(RunError, match="`raw` must be an object"):
        read_jitter(tmp_path, CLIPS, SYSTEMS)


def test_a_clip_named_like_a_way_out_is_not_followed(tmp_path: Path) -> None:
    inside = tmp_path / "inside"
    inside.mkdir()
    for name in ("diagnostics.json", "x.json"):
        (tmp_path / name).write_text(json.dumps(diagnostics(1, 2)))
    with pytest.raises(RunError, match="No diagnostics"):
        read_jitter(inside, ("../x", ".."), SYSTEMS)


def test_votes_are_split_by_reason_and_turned_to_the_smoother() -> None:
    jitter = {("a", "smooth"): 10.0, ("a", "rough"): 30.0}
    votes = joined(
        [
            votes_on(0, (0, 0, 1, 1.0), (1, 1, 0, 0.0), (2, 1, 0, 1.0), because=True),
            votes_on(0, (3, 0, 1, 0.0), (4, 0, 1, 0.5)),
            votes_on(1, (3, 0, 1, 1.0), because=True),  # that clip is not measured
        ]
    )
    found = join_jitter(votes, jitter, CLIPS, SYSTEMS)
    assert found is not None
    assert found.because_smooth is not None and found.other_reasons is not None
    assert (found.because_smooth.wins, found.because_smooth.losses) == (2, 1)
    assert (found.other_reasons.wins, found.other_reasons.losses) == (0, 1)
    (point,) = found.points
    assert (point.clip, point.smoother, point.rougher) == ("a", "smooth", "rough")
    assert (point.jerk_ratio, point.share, point.because_smooth) == (3.0, 0.5, 3)
    assert found.correlation is None


def test_correlation_says_whether_more_jitter_costs_more_votes() -> None:
    jitter = {(clip, "smooth"): 10.0 for clip in CLIPS}
    jitter |= {(clip, "rough"): 20.0 + 10 * i for i, clip in enumerate(CLIPS)}
    for sign in (1, -1):
        groups = []
        for clip in range(4):
            wins = 2 + sign * clip if sign > 0 else 8 - clip
            groups.append(votes_on(clip, *[(r, 0, 1, float(r < wins)) for r in range(10)]))
        found = join_jitter(joined(groups), jitter, CLIPS, SYSTEMS)
        assert found is not None
        assert found.correlation == pytest.approx(sign)


def test_without_a_measured_pair_there_is_nothing_to_join() -> None:
    votes = made_votes([(0, 0, 1, 1.0)])
    assert join_jitter(votes, {("a", "smooth"): 1.0}, CLIPS, SYSTEMS) is None
    equal = {("a", "smooth"): 1.0, ("a", "rough"): 1.0}
    assert join_jitter(votes, equal, CLIPS, SYSTEMS) is None
    assert np.isfinite(votes.score).all()
