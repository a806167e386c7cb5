"""A whole run as one file: motions, speech, words and plans, which the page opens again.

The file holds no numbers and nothing that a page would show as it is: whoever opens it has its
motions measured anew, so that nobody can be shown what was never measured.
"""

from __future__ import annotations

import json
import re
import threading
import wave
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from fastapi import Response
from fastapi.responses import FileResponse, PlainTextResponse
from fastapi.routing import APIRoute
from pydantic import BaseModel, ConfigDict, Field, ValidationError
from starlette.concurrency import run_in_threadpool

from app.errors import RunError
from app.page.results.kept_runs import RUN_ROUTE, KeptRuns
from app.run.many.unpacked import Limits, unpacked
from app.run.requests.request import MAX_COMPARED
from conventions.names import REFERENCE_NAME, printable
from model.speech.transcript import Accent, GestureTier, Interval, Transcript, Word
from model.storage.files import written_atomically

if TYPE_CHECKING:
    from app.page.results.kept_runs import EndedRun

FORMAT = 1
TOLD, SPEECH, ENDING = "run.json", "speech.wav", ".run.zip"
PAGE_ENDING = ".run.html"
"""Of a run as a page that plays anywhere."""
LIMITS = Limits(files=2 * MAX_COMPARED + 2, total_bytes=10**9)
GONE = "There is no such run, or it is kept no longer."
DAMAGED = "{name} holds no run that this page can open ({why}); save it from its page once more."
_MAX_TOLD_BYTES = 5_000_000
_MAX_TEXT, _MAX_PARTS = 300, 20_000
_MAX_STEM = 60

Name = Annotated[str, Field(min_length=1, max_length=120)]
Text = Annotated[str, Field(max_length=_MAX_TEXT)]
Seconds = Annotated[float, Field(ge=0, le=1e5, allow_inf_nan=False)]
Part = tuple[Seconds, Seconds, Text]
Parts = Annotated[list[Part], Field(max_length=_MAX_PARTS)]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)


class SavedRow(_Strict):
    """One motion."""

    name: Name
    motion: Annotated[str, Field(pattern=r"^motion-\d{1,2}\.npz$")]
    plan: Annotated[str, Field(pattern=r"^plan-\d{1,2}\.json$")] | None = None


class SavedRun(_Strict):
    """What ``run.json`` says."""

    format: Literal[1]
    title: Text
    settings: Annotated[dict[Text, Text], Field(max_length=60)]
    speech_sha256: Annotated[str, Field(pattern=r"^[0-9a-f]{0,64}$")]
    joint: Annotated[str, Field(pattern=r"^[a-z_0-9]{1,40}$")]
    rows: Annotated[list[SavedRow], Field(min_length=1, max_length=MAX_COMPARED)]
    has_speech: bool
    words_origin: Literal["given", "aligned", "recognised"] = "given"
    words: Parts = []
    phones: Parts = []
    accents: Annotated[list[tuple[Seconds, float]], Field(max_length=_MAX_PARTS)] = []
    gestures: Annotated[dict[Text, Parts], Field(max_length=20)] = {}

    @property
    def said(self) -> Transcript:
        return Transcript(
            tuple(Word(*part) for part in self.words),
            tuple(
                GestureTier(name, tuple(Interval(*part) for part in parts))
                for name, parts in self.gestures.items()
            ),
            self.words_origin,
            tuple(Interval(*part) for part in self.phones),
            tuple(Accent(*accent) for accent in self.accents),
        )


@dataclass(frozen=True)
class OpenedRun:
    """A saved run whose files are there."""

    told: SavedRun
    motions: dict[str, Path]
    """By row, the reference among them."""
    plans: dict[str, Path]
    speech: Path | None


def save_run(run: EndedRun, out: Path) -> Path:
    """Write a run that has ended into ``out``, whole or not at all; its first motions where it has
    more than fit a stage of one's own. Takes of edited plans are not among them."""
    assert run.showing is not None
    timeline = run.showing.timeline()
    motions = run.showing.drawn()
    others = [name for name in motions if name != REFERENCE_NAME]
    has_reference = REFERENCE_NAME in motions
    shown = others[: MAX_COMPARED - has_reference] + [REFERENCE_NAME] * has_reference
    plans = {name: path for name, path in run.showing.performed.items() if path.is_file()}
    sound = _heard(run.showing.sound())
    rows = [
        SavedRow(
            name=name,
            motion=f"motion-{number}.npz",
            plan=f"plan-{number}.json" if name in plans else None,
        )
        for number, name in enumerate(shown)
    ]
    told = SavedRun(
        format=FORMAT,
        title=run.title[:_MAX_TEXT],
        settings={key[:_MAX_TEXT]: value[:_MAX_TEXT] for key, value in run.settings.items()},
        speech_sha256=run.speech_sha256,
        joint=run.diagnostics.point,
        rows=rows,
        has_speech=sound is not None,
        **{key: timeline[key] for key in _TIMED if key in timeline},
    )
    with written_atomically(out) as temporary, zipfile.ZipFile(temporary, "w") as archive:
        archive.writestr(TOLD, told.model_dump_json(), zipfile.ZIP_STORED)  # first: `is_saved_run`
        for row in rows:
            archive.write(motions[row.name], row.motion)
            if row.plan is not None:
                archive.write(plans[row.name], row.plan, zipfile.ZIP_DEFLATED)
        if sound is not None:
            archive.write(sound, SPEECH, zipfile.ZIP_DEFLATED)
    return out


def _heard(sound: Path | None) -> Path | None:
    """A sound in which there is anything: motion without speech plays to silence."""
    if sound is None:
        return None
    with wave.open(str(sound)) as file:
        return sound if any(file.readframes(file.getnframes())) else None


_TIMED = ("words_origin", "words", "phones", "accents", "gestures")


def is_saved_run(path: Path) -> bool:
    """Whether a zip begins as `save_run` begins it."""
    try:
        with path.open("rb") as file:
            head = file.read(30 + len(TOLD))
    except OSError:
        return False
    return head[:4] == b"PK\x03\x04" and head[30:] == TOLD.encode()


def open_run(path: Path, folder: Path) -> OpenedRun:
    """Unpack a saved run into a folder that does not exist yet. Its motions are not read here.

    Raises:
        RunError: with a sentence, for anything else than `save_run` writes.
    """
    folder.mkdir(parents=True)
    unpacked(path, folder, (".json", ".npz", ".wav"), LIMITS)
    told_path, name = folder / TOLD, printable(path.name)
    if not told_path.is_file() or told_path.stat().st_size > _MAX_TOLD_BYTES:
        raise RunError(DAMAGED.format(name=name, why=f"{TOLD} is missing or too long"))
    try:
        told = SavedRun.model_validate(json.loads(told_path.read_bytes()))
    except (ValidationError, ValueError, RecursionError) as error:
        raise RunError(DAMAGED.format(name=name, why=f"{TOLD} is damaged")) from error
    motions = {printable(row.name): folder / row.motion for row in told.rows}
    plans = {printable(row.name): folder / row.plan for row in told.rows if row.plan is not None}
    speech = folder / SPEECH if told.has_speech else None
    files: Sequence[Path] = [*motions.values(), *plans.values(), *([speech] if speech else [])]
    if len(motions) < len(told.rows) or set(motions) == {REFERENCE_NAME}:
        raise RunError(DAMAGED.format(name=name, why="its motions have no names of their own"))
    if not all(file.is_file() for file in files):
        raise RunError(DAMAGED.format(name=name, why="a file is missing"))
    return OpenedRun(told, motions, plans, speech)


def file_name(title: str, ending: str = ENDING) -> str:
    """Of a run's file, from what the run is called."""
    stem = re.sub(r"[^\w .,+-]+", "-", title).strip(" .-")[:_MAX_STEM]
    return f"{stem or 'run'}{ending}"


def run_file_routes(kept: KeptRuns) -> list[APIRoute]:
    """Serve runs as files that the page opens again."""
    return [saving_route(kept, RUN_ROUTE + "/{token}", ENDING, "application/zip", save_run)]


def saving_route(
    kept: KeptRuns, path: str, ending: str, media_type: str, save: Callable[[EndedRun, Path], Path]
) -> APIRoute:
    """Serve runs in one form, each written by ``save`` when it is first asked for; always as a
    file to be saved, so that nothing of it is opened as a page of this server."""
    lock = threading.Lock()

    def saved(token: str) -> tuple[Path, str] | None:
        run = kept.find(token)
        if run is None or run.run.showing is None:
            return None
        out = run.job.folder / f"saved{ending}"
        with lock:
            if not out.is_file():
                save(run.run, out)
        return out, file_name(run.run.title, ending)

    async def answer(token: str) -> Response:
        found = await run_in_threadpool(saved, token)
        if found is None:
            return PlainTextResponse(GONE, status_code=404)
        headers = {"Cache-Control": "no-store", "X-Content-Type-Options": "nosniff"}
        return FileResponse(found[0], filename=found[1], media_type=media_type, headers=headers)

    return APIRoute(path, answer, methods=["GET"], include_in_schema=False)
