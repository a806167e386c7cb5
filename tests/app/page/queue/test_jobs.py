"""Whose turn it is, as a visitor meets it: order, place, limits, cancelling, making way."""

import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack

import pytest

from app.errors import CancelledRun, RunError
from app.page.queue.jobs import Job, JobBook


def in_threads(*calls: Callable[[], None]) -> None:
    threads = [threading.Thread(target=call) for call in calls]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60)
        assert not thread.is_alive()


def begun_in_order(jobs: JobBook, opened: Sequence[Job]) -> tuple[list[str], list[int]]:
    """Whose runs begin one after the other, each as soon as the one before has ended, and how many
    each was told to be before it at first; the first is at work from the start."""
    order: list[str] = []

    def work(job: Job, turn: Iterator[int], slot: ExitStack) -> None:
        list(turn)
        order.append(job.visitor)
        slot.close()
        jobs.close(job)

    slots = [ExitStack() for _ in opened]
    turns = [slot.enter_context(jobs.slot(job)) for slot, job in zip(slots, opened, strict=True)]
    assert list(turns[0]) == []
    before = [next(turn) for turn in turns[1:]]
    calls = [lambda told=told: work(*told) for told in zip(opened, turns, slots, strict=True)]
    in_threads(*calls[1:], calls[0])
    assert order[0] == opened[0].visitor and len(order) == len(opened)
    return order, before


def test_runs_go_one_at_a_time_in_order_of_arrival_each_in_a_folder_of_its_own(tmp_path):
    jobs = JobBook(tmp_path / "jobs")
    opened = [jobs.open(name, "generate") for name in ("first", "second", "third")]
    folders = [job.folder for job in opened]
    assert len(set(folders)) == 3 and jobs.in_use() == folders
    assert all(folder.stat().st_mode & 0o777 == 0o700 for folder in folders)
    assert begun_in_order(jobs, opened) == (["first", "second", "third"], [1, 2])
    assert not jobs.in_use() and all(folder.is_dir() for folder in folders), "for the downloads"


def test_a_waiting_run_can_be_cancelled_and_leaves_its_place(tmp_path):
    jobs = JobBook(tmp_path)
    first, second, third = (jobs.open(name, "generate") for name in "abc")
    with jobs.slot(first) as turn, jobs.slot(second) as waiting, jobs.slot(third) as behind:
        assert (list(turn), next(waiting), next(behind)) == ([], 1, 2)
        jobs.cancel("b", "generate")
        with pytest.raises(CancelledRun):
            next(waiting)
        jobs.close(second)
        assert next(behind) == 1


def test_cancelling_stops_the_runs_of_one_tab_of_one_visitor(tmp_path):
    jobs = JobBook(tmp_path)
    first, second, ended = (jobs.open("one", "generate") for _ in range(3))
    others = [jobs.open("one", "study"), jobs.open("two", "generate")]
    jobs.close(ended)
    assert not first.is_cancelled()
    assert jobs.cancel("one", "generate") and first.is_cancelled() and second.is_cancelled()
    assert not any(other.is_cancelled() for other in (*others, ended))
    assert not jobs.cancel("one", "own_motion") and not jobs.cancel("nobody", "generate")
    jobs.cancel_all()
    assert all(other.is_cancelled() for other in others)
    first.is_put_back = others[0].is_put_back = True
    assert jobs.again(first) is None, "what its visitor cancels does not begin anew"


def test_no_more_than_the_limit_are_let_in_however_many_come_at_once(tmp_path):
    jobs = JobBook(tmp_path, max_waiting=3)
    barrier = threading.Barrier(20)
    let_in, turned_away = [], []

    def join(number: int) -> None:
        barrier.wait(60)
        try:
            let_in.append(jobs.open(f"visitor {number}", "generate", f"address {number}"))
        except RunError as error:
            turned_away.append(str(error))

    in_threads(*(lambda number=number: join(number) for number in range(20)))
    assert len(let_in) == len(list(tmp_path.iterdir())) == 4
    assert len(turned_away) == 16 and all("3 runs waiting" in told for told in turned_away)
    jobs.close(let_in[0])
    jobs.open("one more", "generate")


@pytest.mark.parametrize("flood", ["10.0.0.1", "10.0.0.2"], ids=["same address", "another"])
def test_many_runs_of_one_visitor_do_not_hold_up_the_others(tmp_path, flood):
    """Behind one address pages take turns, and addresses do."""
    jobs = JobBook(tmp_path)
    opened = [jobs.open("flood", "own_motion", flood) for _ in range(4)]
    opened += [jobs.open(name, "generate", "10.0.0.1") for name in "ab"]
    order, _ = begun_in_order(jobs, opened)
    expected = ["flood", "a", "b", "flood", "flood", "flood"]
    if flood == "10.0.0.2":
        expected = ["flood", "a", "flood", "b", "flood", "flood"]
    assert order == expected


def test_who_has_no_run_waiting_gets_a_place_of_who_has_many(tmp_path):
    jobs = JobBook(tmp_path, max_waiting=3)
    flood = [jobs.open(f"flood {number}", "own_motion", "10.0.0.1") for number in range(4)]
    newcomer = jobs.open("newcomer", "generate", "10.0.0.2")
    with jobs.slot(flood[3]) as turn, pytest.raises(RunError, match="gave its place up"):
        list(turn)
    jobs.close(flood[3])
    assert begun_in_order(jobs, [*flood[:3], newcomer])[0][1] == "newcomer"
    with pytest.raises(RunError, match="3 runs waiting"):
        [jobs.open("flood", "own_motion", "10.0.0.1") for _ in range(5)]


def test_videos_come_last_and_make_way_those_that_were_asked_for_before_the_others(tmp_path):
    jobs = JobBook(tmp_path, max_waiting=1)
    usual, another = (jobs.open(name, "videos", f"10.0.0.{name}") for name in "12")
    with ExitStack() as at_work, jobs.slot(another) as held:
        assert list(at_work.enter_context(jobs.slot(usual))) == []
        run = jobs.open("1", "generate", "10.0.0.1")  # no video takes a run's waiting place
        with jobs.slot(run) as waiting:
            assert next(held) == 2 and not usual.is_put_back, "the run goes first"
            assert next(waiting) == 1 and usual.is_put_back
            at_work.close()
            anew = jobs.again(usual)
            assert anew is not None and not usual.folder.exists()
            assert list(waiting) == []
            jobs.max_waiting = 3
            asked = jobs.open("1", "seen", "10.0.0.1")
        jobs.close(run)
        with jobs.slot(asked) as seen:
            assert list(seen) == [], "the others came before it"
            with jobs.slot(jobs.open("2", "generate", "10.0.0.2")) as waiting:
                assert next(waiting) == 1 and asked.is_put_back
        assert jobs.cancel("1", "videos") and anew.is_cancelled()
