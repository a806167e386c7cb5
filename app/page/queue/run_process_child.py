"""The child of `app.page.queue.run_processes`: tasks come in, news and one outcome go out."""

from __future__ import annotations

import os
import queue
import resource
import threading
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from app.errors import CancelledRun, sentence_of
from app.page.queue.run_processes import HEARD
from app.run.output.telling import share_teller
from app.run.requests.request import Artefact, Event, OnEvent, ShouldCancel
from processes.child import parent_channel

_NO_MEMORY = ("allocate memory", "not enough memory", "bad_alloc")
"""What torch says in a RuntimeError."""


def generate(request: Any, on_event: OnEvent, should_cancel: ShouldCancel) -> Any:
    from app.run.pipeline import generate_all

    generate_all(request, on_event, should_cancel)


def diagnose(request: Any, on_event: OnEvent, should_cancel: ShouldCancel) -> Any:
    from app.run.many.opened import diagnose_opened

    diagnose_opened(request, share_teller("numbers", on_event, should_cancel), on_event)


def measure_sets(request: Any, on_event: OnEvent, should_cancel: ShouldCancel) -> Any:
    from app.run.many.sets import measure_sets as measure

    return measure(request, share_teller("numbers", on_event, should_cancel))


def draw_behind(request: Any, on_event: OnEvent, should_cancel: ShouldCancel) -> Any:
    from app.run.videos.behind import draw_behind as draw

    return draw(request, on_event, should_cancel)


def draw_seen(request: Any, on_event: OnEvent, should_cancel: ShouldCancel) -> Any:
    from app.run.videos.seen_video import draw_seen as draw

    return draw(request, on_event, should_cancel)


def make_take(request: Any, on_event: OnEvent, should_cancel: ShouldCancel) -> Any:
    from app.run.takes.take import make_take as make

    return make(request, on_event, should_cancel)


def show_mechanism(request: Any, on_event: OnEvent, should_cancel: ShouldCancel) -> Any:
    from app.run.experiments.mechanism import show_mechanism as show

    return show(request, share_teller("video", on_event, should_cancel), on_event)


def make_first_look(
    look: Any, weights: Path, on_event: OnEvent, should_cancel: ShouldCancel
) -> None:
    from app.run.examples import make_first_look as make

    make(look, weights, share_teller("video", on_event, should_cancel))


def measure_steps(request: Any, on_event: OnEvent, should_cancel: ShouldCancel) -> Any:
    from app.run.experiments.step_curve import measure_step_curve

    return measure_step_curve(request, share_teller("numbers", on_event, should_cancel))


def measure_hearing(request: Any, on_event: OnEvent, should_cancel: ShouldCancel) -> Any:
    from app.run.experiments.hearing import measure_hearing as measure

    return measure(request, share_teller("numbers", on_event, should_cancel))


def export_study(
    plan: Path, out: Path, options: Any, on_event: OnEvent, should_cancel: ShouldCancel
) -> Any:
    from app.study.design.plan import read_plan
    from app.study.export import export_study as export

    return export(
        read_plan(plan),
        out,
        options,
        on_progress=share_teller("video", on_event, should_cancel),
        should_cancel=should_cancel,
    )


def analyse_study(
    answers: Any, key: Path, out: Path, on_event: OnEvent, should_cancel: ShouldCancel
) -> tuple[Path, ...]:
    from app.study.analyse import analyse

    analyse(answers, key, out)
    return (out / "report.html", *sorted(p for p in out.iterdir() if p.suffix != ".html"))


def refuse(
    kind: Any, paths: Any, max_speech_s: float, on_event: OnEvent, should_cancel: ShouldCancel
) -> str:
    from app.run.requests.upload_check import refusal_of

    return refusal_of(kind, paths, max_speech_s)


_ALL = (
    *(generate, diagnose, measure_sets, draw_behind, draw_seen, make_take, show_mechanism),
    *(make_first_look, measure_steps, measure_hearing, export_study, analyse_study, refuse),
)
TASKS: dict[str, Callable[..., Any]] = {task.__name__: task for task in _ALL}


def main() -> None:
    """Take work as it comes, and read what all of it needs while there is none."""
    channel, needed = parent_channel()
    works: queue.SimpleQueue[Any] = queue.SimpleQueue()
    stop = threading.Event()
    lock = threading.Lock()
    heard = threading.Semaphore(0)

    def tell(kind: str, value: object) -> None:
        with lock:
            channel.send((kind, value))

    def on_event(event: Event) -> None:
        tell("event", event)
        if isinstance(event, Artefact):
            heard.acquire()

    threading.Thread(target=_listen, args=(channel, works, stop, heard), daemon=True).start()
    reading = _warming_up(*map(Path, needed)) if needed else iter(())
    while True:
        while works.empty() and next(reading, True) is None:
            pass
        task, arguments, memory_bytes = works.get()
        stop.clear()
        before = _limit_memory(memory_bytes)
        try:
            result = TASKS[task](*arguments, on_event, stop.is_set)
            told = ("done", (result, _data_bytes() - before))
        except CancelledRun:
            told = ("cancelled", None)
        except Exception as error:
            if any(words in str(error) for words in _NO_MEMORY):
                error = MemoryError()
            sentence = sentence_of(error)
            told = ("fault", traceback.format_exc()) if sentence is None else ("sentence", sentence)
        _limit_memory(None)
        tell(*told)


def _warming_up(weights: Path, body: Path | None = None) -> Iterator[None]:
    """In small parts; a failure shows at the first run."""
    import app.run.diagnose
    import app.run.pipeline  # noqa: F401
    from app.run import models

    yield
    try:
        yield from models.warming_up(weights, body)
    except Exception:
        traceback.print_exc()


def _listen(
    channel: Any,
    works: queue.SimpleQueue[Any],
    stop: threading.Event,
    heard: threading.Semaphore,
) -> None:
    """Works come, and None, which stops the one under way. Without a parent nobody asks for it."""
    try:
        while True:
            told = channel.recv()
            if told is None:
                stop.set()
            elif told is HEARD:
                heard.release()
            else:
                works.put(told)
    except (EOFError, OSError):
        os._exit(0)


def _limit_memory(more_bytes: int | None) -> int:
    """Let this process, and what it starts, take so much more; returns what it has taken."""
    taken = _data_bytes()
    limit = resource.RLIM_INFINITY if more_bytes is None else taken + more_bytes
    resource.setrlimit(resource.RLIMIT_DATA, (limit, resource.RLIM_INFINITY))
    return taken


def _data_bytes() -> int:
    """What the system counts towards that limit; 0 where it does not tell."""
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
    except OSError:
        return 0
    return next((1024 * int(line.split()[1]) for line in lines if line.startswith("VmData")), 0)


if __name__ == "__main__":
    main()
