"""What a study asks is counted as one would by hand."""

import math
from pathlib import Path

import pytest

from app.study.design.plan import read_plan
from app.study.design.size import ANSWER_S, BEFORE_S, StudySize, size_of
from app.study.design.trials import make_design
from tests.app.study.made_study import write_plan

SYSTEMS = ["ann", "bob", "cleo", "dora"]
CLIPS = ["one", "two", "three"]


def size(folder: Path, protocol: str, extra: str = "") -> StudySize:
    settings = f'protocol = "{protocol}"\nparticipants = 10\nattention_checks = 0\n{extra}'
    plan = read_plan(write_plan(folder, SYSTEMS, CLIPS, settings))
    return size_of(plan, make_design(plan))


@pytest.mark.parametrize(
    ("protocol", "pages", "shown", "votes"),
    [
        ("pairwise", 6 * 3, 2, 10 * 3),  # each of 6 pairs on 3 clips, by 10 people
        ("matched", 4 * 3, 2, 10 * 3),
        ("ranking", 3, 4, 10 * 3),
        ("rating", 3, 4, 10 * 3),
    ],
)
def test_whole_lists_are_counted_by_hand(
    tmp_path: Path, protocol: str, pages: int, shown: int, votes: int
) -> None:
    found = size(tmp_path, protocol, "length_s = 6")
    minutes = math.ceil((BEFORE_S + pages * (shown * 6 + ANSWER_S)) / 60)
    assert (found.num_pages, found.minutes) == (pages, minutes)
    assert (found.fewest, found.most) == (votes, votes)


def test_part_lists_share_the_votes(tmp_path: Path) -> None:
    found = size(tmp_path, "pairwise", "trials_per_participant = 5")
    assert found.num_pages == 5
    assert found.fewest <= 10 * 5 / 6 <= found.most  # 50 votes over 6 pairs
    assert found.fewest < found.most


def test_a_sentence_for_the_researcher() -> None:
    assert StudySize(7, 18, "pair", 28, 28).sentence() == (
        "About 7 minutes and 18 pages for each participant; 28 votes for each pair of systems if "
        "all finish."
    )
    assert StudySize(1, 1, "rank", 0, 1).sentence() == (
        "About 1 minute and 1 page for each participant; 0 to 1 ranking for each system if all "
        "finish."
    )
