import threading
import time
from contextlib import ExitStack
from pathlib import Path

import pytest

from app.config import AppConfig
from app.errors import CancelledRun, RunError
from app.page.queue.jobs import Job, JobBook
from app.page.visitors.visitor_files import VisitorFiles
from tests.app.page.queue.test_run_processes import zeros


def test_each_job_has_a_folder_of_its_own_that_others_cannot_enter(tmp_path: Path) -> None:
    jobs = JobBook(tmp_path / "jobs")
    one, two = jobs.open("one", "study"), jobs.open("two", "study")
    assert one.folder != two.folder
    assert one.folder.stat().st_mode & 0o777 == 0o700


def test_cancelling_stops_the_runs_of_one_tab_of_one_visitor(tmp_path: Path) -> None:
    jobs = JobBook(tmp_path)
    first, second = jobs.open("one", "generate"), jobs.open("one", "generate")
    others = [jobs.open("one", "study"), jobs.open("two", "generate")]
    assert not first.is_cancelled()
    assert jobs.cancel("one", "generate") and first.is_cancelled() and second.is_cancelled()
    assert not any(other.is_cancelled() for other in others)
    assert not jobs.cancel("one", "own_motion") and not jobs.cancel("nobody", "generate")
    jobs.cancel_all()
    assert all(other.is_cancelled() for other in others)


def test_runs_go_one_at_a_time_in_order_of_arrival_and_are_told_their_place(
    tmp_path: Path,
) -> None:
    jobs = JobBook(tmp_path)
    order: list[str] = []
    places: dict[str, list[int]] = {}
    release = threading.Event()
    at_work = threading.Event()

    def work(name: str) -> None:
        with jobs.slot(jobs.open(name, "generate")) as turn:
            places[name] = list(turn)
            order.append(name)
            at_work.set()
            release.wait(10)

    threads = []
    for name in ("first", "second", "third"):
        threads.append(threading.Thread(target=work, args=(name,)))
        threads[-1].start()
        at_work.wait(10)
        time.sleep(0.05)  # so that it stands in the queue before the next one comes
    assert order == ["first"]
    release.set()
    for thread in threads:
        thread.join(10)
    assert order == ["first", "second", "third"]
    assert places["first"] == []
    assert places["second"][0] == 1
    assert places["third"][0] == 2


def test_a_waiting_run_can_be_cancelled_and_leaves_its_place(tmp_path: Path) -> None:
    jobs = JobBook(tmp_path)
    with jobs.slot(jobs.open("first", "generate")) as turn:
        assert list(turn) == []
        with jobs.slot(jobs.open("second", "generate")) as waiting:
            assert next(waiting) == 1
            jobs.cancel("second", "generate")
            with pytest.raises(CancelledRun):
                next(waiting)
    with jobs.slot(jobs.open("third", "generate")) as turn:
        assert list(turn) == []


def test_more_than_the_limit_are_turned_away(tmp_path: Path) -> None:
    jobs = JobBook(tmp_path, max_waiting=1)
    with jobs.slot(jobs.open("working", "generate")) as turn:
        list(turn)
        waiting = jobs.open("waiting", "generate")
        with jobs.slot(waiting), pytest.raises(RunError, match="1 runs waiting"):
            jobs.open("too many", "generate")


def test_no_more_than_the_limit_are_let_in_however_many_come_at_once(tmp_path: Path) -> None:
    jobs = JobBook(tmp_path)  # one at work and 16 waiting
    barrier = threading.Barrier(60)
    let_in, turned_away = [], []

    def join(number: int) -> None:
        barrier.wait(10)
        try:
            let_in.append(jobs.open(f"visitor {number}", "generate", f"address {number}"))
        except RunError:
            turned_away.append(number)

    threads = [threading.Thread(target=join, args=(number,)) for number in range(60)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(10)
    assert (len(let_in), len(turned_away)) == (17, 43)
    assert len(list(tmp_path.iterdir())) == 17
    jobs.close(let_in[0])
    jobs.open("one more", "generate")


def begun_in_order(jobs: JobBook, opened: list[Job]) -> list[str]:
    """Whose runs begin one after the other, each as soon as the one before has ended."""
    order: list[str] = []

    def work(job: Job) -> None:
        with jobs.slot(job) as turn:
            list(turn)
            order.append(job.visitor)
        jobs.close(job)

    threads = [threading.Thread(target=work, args=(job,)) for job in opened]
    with jobs.slot(opened[0]) as turn:
        list(turn)
        order.append(opened[0].visitor)
        for thread in threads[1:]:
            thread.start()
    for thread in threads[1:]:
        thread.join(20)
    return order


def test_many_runs_of_one_address_do_not_hold_up_the_others(tmp_path: Path) -> None:
    jobs = JobBook(tmp_path)
    opened = [jobs.open(f"flood {number}", "own_motion", "10.0.0.1") for number in range(6)]
    opened += [jobs.open(name, "generate", f"10.0.1.{name}") for name in "ab"]
    order = begun_in_order(jobs, opened)
    assert order[:3] == ["flood 0", "a", "b"]
    assert order[3:] == [f"flood {number}" for number in range(1, 6)]


def test_many_runs_of_one_page_do_not_hold_up_others_behind_the_same_address(
    tmp_path: Path,
) -> None:
    jobs = JobBook(tmp_path)
    opened = [jobs.open("flood", "own_motion", "10.0.0.1") for _ in range(4)]
    opened += [jobs.open(name, "generate", "10.0.0.1") for name in "ab"]
    assert begun_in_order(jobs, opened) == ["flood", "a", "b", "flood", "flood", "flood"]


def test_who_has_no_run_waiting_gets_a_place_of_who_has_many(tmp_path: Path) -> None:
    jobs = JobBook(tmp_path, max_waiting=3)
    flood = [jobs.open(f"flood {number}", "own_motion", "10.0.0.1") for number in range(4)]
    newcomer = jobs.open("newcomer", "generate", "10.0.0.2")
    with jobs.slot(flood[3]) as turn, pytest.raises(RunError, match="gave its place up"):
        list(turn)
    jobs.close(flood[3])
    assert begun_in_order(jobs, [*flood[:3], newcomer])[1] == "newcomer"
    with pytest.raises(RunError, match="3 runs waiting"):
        [jobs.open("flood", "own_motion", "10.0.0.1") for _ in range(5)]


def test_a_closed_run_is_forgotten_and_the_visitors_other_run_is_not(tmp_path: Path) -> None:
    jobs = JobBook(tmp_path)
    old, new = jobs.open("one", "study"), jobs.open("one", "study")
    jobs.close(old)
    assert jobs.cancel("one", "study") and new.is_cancelled() and not old.is_cancelled()
    jobs.close(new)
    assert not jobs.cancel("one", "study")


def test_what_takes_long_steps_aside_for_another_address(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("app.page.queue.jobs.LONG_S", 0.3)
    jobs = JobBook(tmp_path)
    long, more = (jobs.open("flood", "own_motion", "10.0.0.1") for _ in range(2))

    def newcomer(number: int) -> Job:
        return jobs.open("newcomer", "generate", f"10.0.1.{number}")

    with jobs.slot(more) as held:
        with jobs.slot(long) as turn:
            list(turn)
            began = time.monotonic()
            with jobs.slot(newcomer(1)) as waiting:
                assert list(waiting) == [1] and time.monotonic() - began > 0.3
                assert next(held) == 1
            with jobs.slot(newcomer(2)) as waiting:
                assert list(waiting) == []  # `more` came first, but its address has one aside
                time.sleep(0.4)
                with jobs.slot(newcomer(3)) as another:
                    assert next(another) == 1  # one is aside already
        assert list(held) in ([], [0])


def test_what_takes_long_steps_aside_for_another_visitor_of_its_address(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("app.page.queue.jobs.LONG_S", 0.0)
    jobs = JobBook(tmp_path)
    first, more, second = (jobs.open(name, "generate", "10.0.0.1") for name in "aab")
    with jobs.slot(first) as turn:
        list(turn)
        with jobs.slot(more) as held:
            assert next(held) == 2 and jobs._aside == []  # among one visitor's own none does
            with jobs.slot(second) as waiting:
                assert list(waiting) in ([], [1]) and jobs._aside == [first]
            assert next(held) == 0  # it waits for the one aside


def hours(jobs: JobBook, names: str, address: str = "10.0.0.1") -> list[Job]:
    opened = [jobs.open(name, "own_motion", address) for name in names]
    for job in opened:
        job.is_large = True
    return opened


def test_six_hours_let_a_short_run_of_another_tab_through_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("app.page.queue.jobs.LARGE_S", 0.0)
    jobs = JobBook(tmp_path)
    large = hours(jobs, "uvwxyz")
    with jobs.slot(large[0]) as turn:
        list(turn)
        with jobs.slot(large[1]) as held:
            assert next(held) == 1 and jobs._aside == []  # large ones go one after the other
            for name in "ab":
                with jobs.slot(jobs.open(name, "generate", "10.0.0.1")) as waiting:
                    assert all(ahead == 1 for ahead in waiting)
            assert jobs._aside == large[:1] and jobs._working == []
            with jobs.slot(jobs.open("c", "generate", "10.0.0.2")) as waiting:
                assert list(waiting) == []


def test_a_large_run_has_its_turn_after_a_while_however_many_small_ones_come(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    jobs = JobBook(tmp_path)
    first = jobs.open("first", "generate", "10.0.0.1")
    (large,) = hours(jobs, "z")
    small = jobs.open("small", "generate", "10.0.0.1")
    with jobs.slot(first) as turn:
        list(turn)
        with jobs.slot(large) as patient, jobs.slot(small) as waiting:
            assert (next(patient), next(waiting)) == (2, 1)
            monkeypatch.setattr("app.page.queue.jobs.PATIENCE_S", 0.0)
            assert (next(patient), next(waiting)) == (1, 2)


def test_a_second_long_run_of_an_address_is_put_back_once_for_another_address(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("app.page.queue.jobs.LONG_S", 0.0)
    jobs = JobBook(tmp_path)
    one, two, three = (jobs.open(name, "generate", "10.0.0.1") for name in "abc")
    with jobs.slot(one) as turn:
        list(turn)
        with jobs.slot(two) as turn:
            list(turn)
            assert jobs._aside == [one] and jobs.again(two) is None
            with jobs.slot(three) as near:
                assert next(near) == 1 and not two.is_put_back  # of its own address: not so soon
            with jobs.slot(jobs.open("d", "generate", "10.0.0.2")) as far:
                assert next(far) == 1 and two.is_put_back and two.is_cancelled()
        anew = jobs.again(two)
        assert anew is not None and anew.folder.is_dir() and not two.folder.exists()
        assert (anew.visitor, anew.tab, anew.is_cancelled()) == ("b", "generate", False)
        with jobs.slot(anew) as held:
            assert next(held) == 0  # until the one aside has ended
            jobs.close(one)
            assert list(held) == []
            with jobs.slot(jobs.open("e", "generate", "10.0.0.2")) as far:
                assert list(far) in ([], [1]) and not anew.is_put_back and jobs._aside == [anew]


def test_a_run_that_its_visitor_cancels_does_not_begin_anew(tmp_path: Path) -> None:
    jobs = JobBook(tmp_path)
    job = jobs.open("a", "generate", "10.0.0.1")
    job.is_put_back = True
    assert jobs.cancel("a", "generate") and jobs.again(job) is None


def test_what_was_uploaded_tells_which_runs_are_large(tmp_path: Path) -> None:
    visitor_files = VisitorFiles(AppConfig(temp=tmp_path, min_free_bytes=0))
    jobs = JobBook(tmp_path / "jobs", visitor_files=visitor_files)
    uploads = tmp_path / "gradio"
    uploads.mkdir()
    zeros(uploads / "hour.npz", 108_000)
    zeros(uploads / "short.npz", 100)
    (uploads / "broken.npz").write_bytes(b"PK")
    (uploads / "minutes.mp3").write_bytes(bytes(2 * 10**6))
    (uploads / "seconds.wav").write_bytes(bytes(2 * 10**6))
    found = {
        path.name
        for path in uploads.iterdir()
        if jobs.open("a", "own_motion", uses=[[str(path)], 3]).is_large
    }
    assert (uploads / "hour.npz").stat().st_size < 10**6
    assert found == {"hour.npz", "minutes.mp3"}


def test_what_nobody_waits_for_comes_last_and_makes_way_at_once(tmp_path: Path) -> None:
    jobs = JobBook(tmp_path, max_waiting=1)
    videos = jobs.open("one", "videos", "10.0.0.1")
    with jobs.slot(videos) as turn:
        assert list(turn) == []
        another = jobs.open("two", "videos", "10.0.0.2")
        run = jobs.open("one", "generate", "10.0.0.1")  # no video takes a run's waiting place
        with jobs.slot(another) as held, jobs.slot(run) as waiting:
            assert next(held) == 2 and not videos.is_put_back, "the run goes first"
            assert next(waiting) == 1 and videos.is_put_back
    anew = jobs.again(videos)
    assert anew is not None and not videos.folder.exists() and not anew.is_large
    with jobs.slot(run) as waiting:
        jobs.close(run)
        run = jobs.open("two", "generate", "10.0.0.2")
    assert jobs.cancel("one", "videos") and anew.is_cancelled() and not run.is_cancelled()


def test_a_video_that_was_asked_for_comes_before_those_that_nobody_waits_for(
    tmp_path: Path,
) -> None:
    jobs = JobBook(tmp_path)
    usual = jobs.open("one", "videos", "10.0.0.1")
    at_work = ExitStack()
    assert list(at_work.enter_context(jobs.slot(usual))) == []
    asked = jobs.open("one", "seen", "10.0.0.1")
    with jobs.slot(asked) as waiting:
        assert next(waiting) == 1 and usual.is_put_back
        at_work.close()
        assert jobs.again(usual) is not None
        assert list(waiting) == [], "the other stands in line"
        run = jobs.open("two", "generate", "10.0.0.2")
        with jobs.slot(run) as waiting:
            assert next(waiting) == 1 and asked.is_put_back
