"""Data of the page's player for one run: the content of its folder with the URLs of one browser."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.errors import without_cli_options
from app.page.routes.media import FileToUrl, SharedFolders
from app.run.examples import FIRST_LOOK
from app.run.output import run_folder
from app.run.output.run_folder import RUN, EditInfo, Row, RowFileKind, RunRecord
from app.run.requests.requests import MAX_NOISE_RAD, MIN_NOISE_RAD, RotationNoiseRequest
from conventions.colors import colors_of
from conventions.names import REFERENCE_NAME, safe_file_stem

if TYPE_CHECKING:
    from app.run.plan_edits.edits import AlternativeEdits

EMPTY_PLAYER_VALUE: dict[str, Any] = {}
_VIEWER_KINDS: tuple[RowFileKind, ...] = ("motion", "frames", "plan", "video")


@dataclass(eq=False)
class RunView:
    """Player data of a run, read from its `run.json` whenever that changes."""

    folder: Path
    to_url: FileToUrl
    name: str = ""
    """Name by which the plan editor refers to the run."""
    will_have_video: bool = False
    """True if each row will have a video."""
    editor_state: dict[str, Any] | None = None
    """State of the plan editor; None if nothing can be edited."""
    _read: tuple[tuple[int, int], RunRecord] | None = None

    @property
    def record(self) -> RunRecord:
        """Current record of the run; raises RunError if there is none."""
        stat = (self.folder / RUN).stat() if (self.folder / RUN).exists() else None
        key = (stat.st_ino, stat.st_mtime_ns) if stat else (0, 0)
        if self._read is None or self._read[0] != key:
            self._read = key, run_folder.read_run(self.folder)
        return self._read[1]

    @property
    def has_begun(self) -> bool:
        return (self.folder / RUN).is_file()

    def file(self, kind: RowFileKind, name: str) -> Path | None:
        """Return the path of a row's file of a kind, or None."""
        row = self.record.row(name)
        return None if row is None else run_folder.existing_file(self.folder, row.files.get(kind))

    def original_rows_with_input_plan(self) -> list[str]:
        """Return the names of the run's original rows from systems that follow a gesture plan."""
        return [
            row.name for row in self.record.rows if "input_plan" in row.files and row.edit is None
        ]

    def set_editor_state(
        self,
        sentence: str = "",
        *,
        is_refused: bool = False,
        is_working: bool = False,
        offers: Sequence[AlternativeEdits] = (),
    ) -> None:
        """Set the message and offers of the plan editor, and whether it generates a take."""
        suggestions = [
            {"label": one.label, "edits": [e.as_json() for e in one.edits]} for one in offers
        ]
        self.editor_state = {
            "message": sentence,
            "is_refused": is_refused,
            "is_working": is_working,
            "suggestions": suggestions,
        }

    def read_only_copy(self, to_url: FileToUrl) -> RunView:
        """Return a copy for another browser, which cannot edit the run."""
        other = copy(self)
        other.to_url, other.editor_state = to_url, None
        return other

    def player_value(self) -> dict[str, Any]:
        """Return the value of the player for the run as it is now."""
        record = self.record
        beside = {"audio": record.audio, "timeline": record.timeline}
        is_running = record.state == "running"
        return {
            "run": self.name or self.folder.name,
            "rows": [self._row(row) for row in record.rows],
            "running": is_running,
            "plays_when_ready": is_running,
            "findings": [
                {
                    "motion_name": each.motion_name,
                    "sentence": each.sentence,
                    "worst_time_s": each.worst_time_s,
                    "part": each.part,
                }
                for each in record.top_findings
            ],
            **({"editing": self._edited(self.editor_state)} if self.editor_state else {}),
            **self._addresses(beside),
        }

    def _edited(self, state: dict[str, Any]) -> dict[str, Any]:
        """Return the state of the plan editor, with the rows that can be edited."""
        editable = {}
        for row in self.record.rows:
            if editor := self.file("editor", row.name):
                take = row.edit or EditInfo(
                    take_number=0, original_row=row.name, parent_row=row.name
                )
                editable[row.name] = {
                    "of": take.original_row,
                    "from": take.parent_row if row.edit else "",
                    "editor": self.to_url(editor),
                }
        return {"rows": self.original_rows_with_input_plan(), "editable": editable, **state}

    def _row(self, row: Row) -> dict[str, Any]:
        files = {kind: name for kind, name in row.files.items() if kind in _VIEWER_KINDS}
        return {
            "name": row.name,
            "label": row.label,
            "color": row.color,
            **self._addresses(files),
            **(
                {"take_number": row.edit.take_number, "original_row": row.edit.original_row}
                if row.edit
                else {}
            ),
            **({"frames_available": row.available.model_dump()} if row.available else {}),
            "stem": safe_file_stem(row.name),
            "is_reference": row.name == REFERENCE_NAME,
            "noise_key": run_folder.noise_group(row.edit.original_row if row.edit else row.name),
            "will_have_video": self.will_have_video,
            "is_planned": "input_plan" in row.files,
            **({"interpretation": _interpretation(row)} if row.assumptions else {}),
        }

    def _addresses(self, names: Any) -> dict[str, str]:
        paths = {kind: run_folder.existing_file(self.folder, name) for kind, name in names.items()}
        return {kind: self.to_url(path) for kind, path in paths.items() if path is not None}


def run_views_in(
    folder: Path, to_url: FileToUrl, name: str, will_have_video: bool = False
) -> dict[str, RunView]:
    """Return the player data of a folder's run under "", or of several clips by name."""
    runs = run_folder.find_runs(folder)
    return {
        clip: RunView(run, to_url, f"{name}{clip}", will_have_video) for clip, run in runs.items()
    }


def _interpretation(row: Row) -> dict[str, Any]:
    """Return the interpretation of a row's file for the player, with its pattern."""
    assumptions = [{**one, "reason": without_cli_options(one["reason"])} for one in row.assumptions]
    return {"file_pattern": f"*{row.source_suffix}", "assumptions": assumptions}


def example_player_value(media: SharedFolders) -> dict[str, Any]:
    """Return the player's value of the example on a newly opened page: the paper's argument."""
    value = RunView(FIRST_LOOK, media.share(FIRST_LOOK, "")).player_value()
    value |= {"running": False, "plays_when_ready": False}
    return rotation_noise_player_value(value, value["rows"][0], RotationNoiseRequest.noise_rad)


ROTATION_SPACES = {"local": "Local rotations", "global": "Global rotations"}
"""Labels of the two bodies with noise."""


def rotation_noise_player_value(
    value: dict[str, Any], clean_row: dict[str, Any], noise_rad: float
) -> dict[str, Any]:
    """Return a player's value of a row twice: noise (rad) on local and on global rotations."""
    colors = colors_of(ROTATION_SPACES, None)
    shared = {
        key: clean_row[key]
        for key in ("frames", "frames_available", "is_reference", "noise_key", "will_have_video")
    }
    rows = [
        {
            **shared,
            "name": name,
            "label": label,
            "stem": name,
            "noise_space": name,
            "color": colors[name],
        }
        for name, label in ROTATION_SPACES.items()
    ]
    noise = {"initial_rad": noise_rad, "range": [MIN_NOISE_RAD, MAX_NOISE_RAD], "has_slider": True}
    return {**value, "rows": rows, "noise": noise, "is_example": True}
