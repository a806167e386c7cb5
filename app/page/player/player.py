"""What the page's player shows of one run: a row for each motion, its sound and its time line."""

from __future__ import annotations

import base64
import json
import threading
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from copy import copy
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from app.findings.sentences import GRAVEST
from app.findings.verdict import short_names
from app.page.player.shown_plans import found_plans, planned
from app.page.player.timeline import (
    heard_accents,
    make_timeline,
    series_looks,
    tiers_of,
    waveform_peaks,
)
from app.page.routes.media import MediaAddresses
from app.page.visitors.visitors import is_same
from app.run.followed_point import choose_tip_source
from app.run.models import get_body
from app.run.pieces import MAX_FRAMES, frames_message
from app.run.requests.request import Artefact, GenerateRequest, Piece
from app.run.videos.export import render_settings
from app.run.videos.own_videos import register_of
from app.run.videos.videos import POSTER_SUFFIX
from app.run.words import given_words
from conventions.names import REFERENCE_NAME, SampleName, file_stem
from conventions.views import CloseUp, Framing, View
from model.speech.transcript import NOTHING_SAID, Transcript

if TYPE_CHECKING:
    import numpy as np

    from app.run.diagnose import DiagnoseRequest
    from conventions.names import Version
    from model.faults.evidence import Finding
    from model.motion.motion import Motion

NOTHING: dict[str, Any] = {}
"""What a player shows before there is anything."""
_ROW_KINDS = ("motion", "poster", "video")


Made = TypeVar("Made")
Write = Callable[[Mapping[str, Path]], Path]
"""Motion files by row to a file that is made of them."""


@dataclass(frozen=True)
class Writers:
    """What is made in a run's folder for the player beside the rows."""

    sound: Write
    timeline: Write
    """Called with all motions, after the sound is written."""
    is_sound_first: bool = False
    """Whether the sound needs no motion, rather than all."""


class Showing:
    """Grows with the files of a run; `value` is what the browser gets, all of it each time."""

    def __init__(
        self,
        names: Sequence[str],
        awaited: Sequence[str],
        layout: Mapping[str, Any],
        write: Writers,
        folder: Path,
        addresses: MediaAddresses,
        visitor: str,
        reference: Path | None = None,
        is_reference_smoothed: bool = False,
    ) -> None:
        """
        Args:
            names: of the rows, in the order of the page.
            awaited: rows whose motion files must be there before the time line can be made.
            layout: as `picture_layout` has it.
            folder: of the job, where sound and time line are kept.
            visitor: the browser's cookie.
            reference: a recorded motion that no run tells of; it is cut to the others' length.
            is_reference_smoothed: whether it is shown behind the post-filter, as the others come.
        """
        self._write = write
        self._reference = reference
        self._is_reference_smoothed = is_reference_smoothed
        self._recorded: Path | None = None
        self._layout = layout
        self._awaited = set(awaited)
        self._folder = folder
        self._addresses = addresses
        self._visitor = visitor
        looks, labels = series_looks(tuple(names)), short_names(names)
        self._rows: dict[str, dict[str, Any]] = {
            name: {
                "name": name,
                "label": labels[name],
                "color": looks[name].color,
                "dashes": list(looks[name].dashes),
            }
            for name in names
        }
        self._files: dict[str, dict[str, Path]] = {name: {} for name in names}
        self.performed: dict[str, Path] = {}
        """By row the plan that it moves by, of those whose system was given one."""
        self.editing: dict[str, Any] | None = None
        """What the player's editor of gestures is told; None where nothing can be edited."""
        self.is_drawn = True
        """Whether each row will have a video."""
        self.findings: list[dict[str, Any]] = []
        """What stands beside the stage, as `gravest_of` gives it."""
        self.assumed: Mapping[str, dict[str, Any]] = {}
        """By row how its file was understood."""
        self._frames: dict[str, dict[str, Any]] = {}
        self._sound: Future[Path] | None = None
        self._timeline: Future[Path] | None = None
        self._plans: dict[str, Path] = {}
        """Of the rows that performed one."""
        self._found_plans: Future[dict[str, Path]] | None = None
        """Of the others."""
        self._urls: dict[Path, str] = {}

    @classmethod
    def of_run(
        cls,
        request: GenerateRequest,
        names: Sequence[str],
        folder: Path,
        addresses: MediaAddresses,
        visitor: str,
        said: Transcript = NOTHING_SAID,
    ) -> Showing:
        """Of generated motion, and of its speech.

        Args:
            said: in the speech, where a transcript was given.
        """
        awaited = [name for name in names if name != REFERENCE_NAME]
        layout = picture_layout(request.views[0], request.size, request.close_ups, request.framing)
        return cls(
            *(names, awaited, layout),
            Writers(
                lambda paths: write_speech(request, folder),
                lambda paths: write_timeline(request, paths, folder, said),
                is_sound_first=True,
            ),
            *(folder, addresses, visitor, request.reference, request.post_filter == "savgol"),
        )

    def add_take(self, name: str, label: str, number: int, of: str) -> None:
        """A row that comes beside the others after the run has ended: motion of a changed plan.

        Args:
            of: the row whose plan was changed.
        """
        look = series_looks((*(each for each in self._rows if each != name), name))[name]
        self._rows[name] = {
            "name": name, "label": label, "color": look.color, "dashes": list(look.dashes),
            "take": number, "of": of,
        }  # fmt: skip
        self._files[name] = {}

    def drop_take(self, name: str) -> None:
        """One that has not come to its end."""
        for each in (self._rows, self._frames, self._files, self._plans, self.performed):
            each.pop(name, None)

    @property
    def motions(self) -> dict[str, Path]:
        """The motion files that have come, takes among them, by row."""
        return dict(self._motions)

    def address_of(self, path: Path) -> str:
        """Where the browser gets a file of the run."""
        return self._url(path)

    def begin(self) -> None:
        """The run has begun: what needs no motion is made meanwhile."""
        if self._sound is None and self._write.is_sound_first:
            self._sound = _begun(self._write.sound, {})

    def take_piece(self, piece: Piece) -> None:
        """Take in motion that is not whole yet: the file of its row grows."""
        path = self._folder / f"{file_stem(piece.name)}.frames"
        is_first = piece.name not in self._frames
        with path.open("wb" if is_first else "ab") as file:
            file.write(piece.frames)
        self._files[piece.name]["frames"] = path
        place = [piece.turn_rad, *piece.shift_m]
        self._note_frames(piece.name, path, piece.end, piece.num_frames, place)
        self._pack_reference(piece.num_frames)

    def take(self, artefact: Artefact) -> None:
        """Note a file that has become whole; the time line is begun with the last motion, and plans
        are looked for in motion after it."""
        if artefact.name not in self._rows:
            return
        if artefact.kind == "plan":
            self.performed[artefact.name] = artefact.path
            self._plans[artefact.name] = planned(artefact.path, artefact.name, self._folder)
        if artefact.kind not in _ROW_KINDS:
            return
        self._files[artefact.name][artefact.kind] = artefact.path
        if artefact.kind != "motion":
            return
        self._pack(artefact.name, _load(artefact.path))
        has_all = self._motions.keys() >= self._awaited
        if self._sound is None and (has_all or self._write.is_sound_first):
            self._sound = _begun(self._write.sound, self._motions)
        if self._timeline is None and has_all and self._sound is not None:
            self._timeline = _begun(self._write.timeline, self._motions, after=self._sound)
            others = {name: path for name, path in self.drawn().items() if name not in self._plans}
            look = partial(found_plans, folder=self._folder)
            self._found_plans = _begun(look, others, after=self._timeline)

    def _pack(self, name: str, motion: Motion) -> None:
        """Write the motion as a browser plays it, where that did not come window by window."""
        count = motion.num_frames
        if name in self._frames or count > MAX_FRAMES:
            return
        path = self._folder / f"{file_stem(name)}.frames"
        path.write_bytes(frames_message(0, motion))
        self._files[name]["frames"] = path
        place = register_of(motion)
        self._note_frames(name, path, count, count, [place.turn_rad, *place.shift_m])
        self._pack_reference(count)

    def _note_frames(
        self, name: str, path: Path, end: int, num_frames: int, place: list[float]
    ) -> None:
        self._frames[name] = {
            "end": end,
            "num_frames": num_frames,
            "bytes": path.stat().st_size,
            "place": place,
        }

    def _pack_reference(self, num_frames: int) -> None:
        """The recorded motion, as soon as its length is known."""
        if self._reference is None or REFERENCE_NAME in self._frames:
            return
        from model.motion.filtering import smooth_motion
        from model.motion.motion import first_frames, save_motion

        recorded = first_frames(_load(self._reference), num_frames)
        if self._is_reference_smoothed:
            recorded = smooth_motion(recorded)
        self._recorded = self._folder / f"{REFERENCE_NAME}.npz"
        save_motion(recorded, self._recorded)
        self._pack(REFERENCE_NAME, recorded)

    def for_visitor(self, visitor: str) -> Showing:
        """The same files for another browser, under addresses of its own."""
        other = copy(self)
        other._visitor, other._urls = visitor, {}
        if not is_same(visitor, self._visitor):
            other.editing = None  # who has the link sees the run, and changes nothing of it
        return other

    def value(self, is_over: bool = False) -> dict[str, Any]:
        """For the player; ``begins`` says that it plays as soon as it can, for who waits for it,
        and ``running`` that more of it is being made.

        Args:
            is_over: whether to wait for the time line and the plans.
        """
        plans = dict(self._plans)
        if self._found_plans is not None and (is_over or self._found_plans.done()):
            plans |= self._found_plans.result()
        beside = {
            name: self._url(made.result())
            for name, made in (("audio", self._sound), ("timeline", self._timeline))
            if made is not None and (is_over or made.done())
        }
        rows = [
            {
                **row,
                **{kind: self._url(path) for kind, path in self._files[name].items()},
                **({"there": dict(self._frames[name])} if name in self._frames else {}),
                **self._recorded_motion(name),
                **({"plan": self._url(plans[name])} if name in plans else {}),
                "stem": file_stem(name),
                "is_reference": name == REFERENCE_NAME,
                "noise": noise_of(row.get("of", name)),
                "is_drawn": self.is_drawn,
                **({"assumed": self.assumed[name]} if name in self.assumed else {}),
            }
            for name, row in self._rows.items()
        ]
        return {
            "run": self._folder.name,
            "rows": rows,
            "layout": self._layout,
            "running": not is_over,
            "begins": not is_over,
            "findings": self.findings,
            **({"editing": self.editing} if self.editing else {}),
            **beside,
        }

    def timeline(self) -> dict[str, Any]:
        """What the time line shows, waited for; empty where nothing has come."""
        return {} if self._timeline is None else json.loads(self._timeline.result().read_text())

    def add_words(self, said: Transcript) -> None:
        """Words that were looked for while the time line was there already. The whole time line
        gets another address, so that a browser takes it anew."""
        if said.origin != "given":
            self.tell_words(said)

    def tell_words(self, said: Transcript) -> None:
        """The same of whatever words."""
        if self._timeline is None:
            return
        made: Future[Path] = Future()
        made.set_result(
            _write_timeline(self.timeline(), said, self._folder, "timeline_with_words.json")
        )
        self._timeline = made

    def drawn(self) -> dict[str, Path]:
        """The motion files of all rows of the run that have one, a reference as long as the
        others."""
        recorded = {} if self._recorded is None else {REFERENCE_NAME: self._recorded}
        made = {name: p for name, p in self._motions.items() if "take" not in self._rows[name]}
        return made | recorded

    def sound(self) -> Path | None:
        """What plays, waited for; None where nothing has come."""
        return None if self._sound is None else self._sound.result()

    def _recorded_motion(self, name: str) -> dict[str, str]:
        if name != REFERENCE_NAME or self._recorded is None:
            return {}
        return {"motion": self._url(self._recorded)}

    @property
    def _motions(self) -> dict[str, Path]:
        return {name: files["motion"] for name, files in self._files.items() if "motion" in files}

    def _url(self, path: Path) -> str:
        """The same one each time; a poster comes with the page, so that it is there before any
        video, however many of them a browser fetches."""
        if path not in self._urls:
            if path.suffix == POSTER_SUFFIX:
                data = base64.b64encode(path.read_bytes()).decode("ascii")
                self._urls[path] = f"data:image/jpeg;base64,{data}"
            else:
                self._urls[path] = self._addresses.address(path, self._visitor)
        return self._urls[path]


def _begun(
    write: Callable[[Mapping[str, Path]], Made],
    motions: Mapping[str, Path],
    after: Future | None = None,
) -> Future[Made]:
    """In a thread: the run itself goes on drawing, and the page is told of it meanwhile."""
    made: Future[Made] = Future()

    def work() -> None:
        try:
            if after is not None:
                after.result()
            made.set_result(write(motions))
        except BaseException as error:
            made.set_exception(error)

    threading.Thread(target=work, name="shown", daemon=True).start()
    return made


def noise_of(name: str) -> str | None:
    """What two rows have in common that were drawn from the same noise in the same way: what
    stands before the slash, and the sample. None of a motion whose noise, if any, is not known."""
    sample = SampleName.parse(name)
    family, slash, _ = sample.system.partition("/")
    return f"{family} {sample.number}" if slash else None


def gravest_of(findings: Mapping[str, Sequence[Finding]]) -> list[dict[str, Any]]:
    """The few gravest of all motions: ``name`` of the motion, ``sentence``, and ``at``, the second
    at which it is worst, or None."""
    from model.faults.evidence import ranked

    return [
        {"name": name, "sentence": finding.sentence, "at": finding.worst_s}
        for name, finding in ranked(findings)[:GRAVEST]
    ]


def picture_layout(
    view: View, size: int, close_ups: tuple[CloseUp, ...], framing: Framing
) -> dict[str, Any]:
    """Where in a video the body and its close-ups stand.

    Returns:
        ``aspect``, width by height of the whole; for ``body`` and for each close-up by its name
        its upper and lower edge, as shares of the height.
    """
    from renderer.scene.panels import CLOSE_UP_VIEWS

    settings = render_settings(view, size, close_ups=close_ups, framing=framing)
    width, height = settings.picture_size
    body, *beside = settings.panels
    edges = {
        name: next(panel for panel in beside if panel.view in CLOSE_UP_VIEWS[name])
        for name in close_ups
    }
    return {"aspect": width / height} | {
        name: [panel.top / height, (panel.top + panel.height) / height]
        for name, panel in {"body": body, **edges}.items()
    }


def write_speech(request: GenerateRequest, folder: Path) -> Path:
    """The speech as the player plays it."""
    from model.speech.audio import SpeechLimits, load_speech, write_wav

    speech = load_speech(request.speech, SpeechLimits(max_s=request.max_speech_s))
    wav = folder / "speech.wav"
    write_wav(wav, speech.waveform)
    return wav


def write_timeline(
    request: GenerateRequest,
    paths: Mapping[str, Path],
    folder: Path,
    said: Transcript = NOTHING_SAID,
) -> Path:
    """What the time line of generated motion shows, as JSON.

    Args:
        paths: motion files of the run by row; a reference is read from the request.
    """
    from model.motion.motion import first_frames
    from model.speech.audio import SpeechLimits, load_speech

    speech = load_speech(request.speech, SpeechLimits(max_s=request.max_speech_s))
    motions = {name: _load(path) for name, path in paths.items()}
    shown: Version = "savgol" if request.post_filter == "savgol" else "raw"
    tip = choose_tip_source(get_body(request.body), request.body, request.joint)
    timeline = make_timeline(speech, motions, shown, tip)
    timeline["heard_accents"] = heard_accents(speech, request.weights)
    if request.reference is not None:
        reference = first_frames(_load(request.reference), speech.num_frames)
        recorded = make_timeline(None, {REFERENCE_NAME: reference}, "raw", tip)
        timeline["curves"] |= recorded["curves"]
    return _write_timeline(timeline, said, folder)


def own_writers(request: DiagnoseRequest, folder: Path, weights: Path | None = None) -> Writers:
    """The same for motion files of a visitor's own: sound as long as the longest of them, silent
    where they gave none.

    Args:
        weights: where the speech encoder is, whose accents are shown; None shows none.
    """
    return Writers(
        lambda paths: _write_own_sound(request, paths, folder),
        lambda paths: _write_own_timeline(request, paths, folder, weights),
    )


def _write_own_sound(request: DiagnoseRequest, paths: Mapping[str, Path], folder: Path) -> Path:
    from model.speech.audio import write_wav

    wav = folder / "speech.wav"
    write_wav(wav, _own_waveform(request, _longest_s(paths)))
    return wav


def _write_own_timeline(
    request: DiagnoseRequest, paths: Mapping[str, Path], folder: Path, weights: Path | None
) -> Path:
    """
    Args:
        paths: motion files by row, the reference among them.
    """
    from model.speech.audio import SpeechLimits, load_speech

    motions = {name: _load(path) for name, path in paths.items()}
    limits = SpeechLimits(channel=request.channel)
    speech = load_speech(request.speech, limits) if request.speech is not None else None
    tip = choose_tip_source(get_body(request.body), request.body, request.joint)
    timeline = make_timeline(speech, motions, "raw", tip)
    longest_s = _longest_s(paths)
    timeline["duration_s"] = round(max(longest_s, timeline["duration_s"]), 4)
    timeline["worst"] = [each for each in timeline["worst"] if each["name"] != REFERENCE_NAME]
    if speech is not None:
        timeline["peaks"] = waveform_peaks(_own_waveform(request, longest_s))
        timeline["heard_accents"] = [] if weights is None else heard_accents(speech, weights)
    return _write_timeline(timeline, given_words(request.transcript), folder)


def _own_waveform(request: DiagnoseRequest, longest_s: float) -> np.ndarray:
    import numpy as np

    from conventions.rates import SAMPLE_RATE
    from model.speech.audio import SpeechLimits, load_speech

    waveform = np.zeros(0, np.float32)
    if request.speech is not None:
        waveform = load_speech(request.speech, SpeechLimits(channel=request.channel)).waveform
    missing = round(longest_s * SAMPLE_RATE) - len(waveform)
    return np.pad(waveform, (0, max(0, missing)))


def _longest_s(paths: Mapping[str, Path]) -> float:
    return max(_load(path).duration_s for path in paths.values())


def _load(path: Path) -> Motion:
    from model.motion.motion import load_motion  # only now: the page starts without torch

    return load_motion(path)


def _write_timeline(
    timeline: Mapping[str, Any], said: Transcript, folder: Path, name: str = "timeline.json"
) -> Path:
    path = folder / name
    whole = {**timeline, **tiers_of(said)}
    path.write_text(json.dumps(whole, allow_nan=False, separators=(",", ":")))
    return path
