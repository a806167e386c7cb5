"""From a plan to the bundle for participants and the folder for the researcher."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from app.errors import RunError
from app.run.models import get_system
from app.run.output.result_folder import held_folder
from app.run.output.telling import share_teller
from app.run.requests.request import OnEvent, ShouldCancel
from app.run.videos.videos import draw_videos
from app.study.design.blinding import Blinding, blinding_of, draw_blinding, make_key
from app.study.design.key import read_key, write_key
from app.study.design.plan import Plan, read_plan
from app.study.design.trials import Design, make_design
from app.study.leaks import check_study
from app.study.make.adapters import write_adapters
from app.study.make.motions import Source, read_sources
from app.study.make.participant_page import write_page
from app.study.make.records import write_records
from app.study.make.scenes import Draw, Maker
from app.study.make.workspace import ExportOptions, Workspace, sha256


@dataclass(frozen=True)
class ExportRequest:
    """A study that is to be made of the plan in a file."""

    plan: Path
    out: Path
    options: ExportOptions


def export_planned(
    request: ExportRequest, on_event: OnEvent, should_cancel: ShouldCancel, draw: Draw = draw_videos
) -> Workspace:
    """As `export_study`."""
    return export_study(
        read_plan(request.plan),
        request.out,
        request.options,
        on_progress=share_teller("video", on_event, should_cancel),
        should_cancel=should_cancel,
        draw=draw,
    )


def export_study(
    plan: Plan,
    out: Path,
    options: ExportOptions | None = None,
    *,
    on_progress: Callable[[float], None] = lambda fraction: None,
    should_cancel: Callable[[], bool] = lambda: False,
    draw: Draw = draw_videos,
) -> Workspace:
    """Make ``out/participant_bundle`` and ``out/researcher_only``, or finish making them.

    The key is written before anything else. A run that is stopped and started again with the same
    plan keeps the key and the finished videos, and ends with the same bytes as one that was not.

    Args:
        on_progress: called with the share done, 0 to 1.

    Raises:
        CancelledRun: when ``should_cancel`` said so; what is finished stays for the next run.
        RunError, SpeechError, MotionError, UnknownNameError, CheckpointError, BodyError, GLError,
        VideoError, WriteError: each with one sentence.
    """
    options = options or ExportOptions()
    design = make_design(plan)
    sources = read_sources(plan)
    workspace = Workspace(out.absolute() if options.pool else out)
    fingerprint = _fingerprint(plan, sources, options)
    with held_folder(out):
        workspace.open(fingerprint)
        _make(plan, design, sources, options, workspace, on_progress, should_cancel, draw)
        leaks = check_study(out)
    if leaks:
        raise RunError(f"The export is not blind: {leaks[0]}")
    return workspace


def _make(
    plan: Plan,
    design: Design,
    sources: tuple[Source, ...],
    options: ExportOptions,
    workspace: Workspace,
    on_progress: Callable[[float], None],
    should_cancel: Callable[[], bool],
    draw: Draw,
) -> None:
    blinding = _blinding(plan, design, workspace)
    maker = Maker(
        *(plan, workspace, blinding.videos, options.weights, options.body, should_cancel),
        *(draw, options.parallel),
    )
    if options.pool is None:
        maker.make_all(sources, on_progress)
    else:
        maker.make_shared(sources, options.pool, on_progress)
    secret = read_key(workspace.key).link_secret
    key = replace(make_key(plan, design, blinding, workspace.digests), link_secret=secret)
    write_page(plan, design, blinding, workspace)
    write_adapters(plan, design, blinding, workspace)
    write_records(plan, design, blinding, sources, options, workspace)
    workspace.clean()
    write_key(key, workspace.key)


def _blinding(plan: Plan, design: Design, workspace: Workspace) -> Blinding:
    """The ids of an earlier run, or new ones, which are kept before anything uses them."""
    if workspace.key.is_file():
        return blinding_of(read_key(workspace.key), plan, design)
    blinding = draw_blinding(design)
    write_key(make_key(plan, design, blinding, {}), workspace.key)
    return blinding


def _fingerprint(plan: Plan, sources: tuple[Source, ...], options: ExportOptions) -> str:
    """Of everything that decides what the videos show.

    Raises:
        UnknownNameError: if a system or its speaker does not exist.
    """
    weights = {}
    for planned in plan.systems:
        if planned.generator is not None:
            system = get_system(planned.generator.system, options.weights)
            if planned.generator.speaker is not None:
                system.speaker_index(planned.generator.speaker)
            weights[system.name] = list(system.sha256s.values())
    facts = {
        "plan": asdict(plan),
        "files": {source.clip.name: dict(source.files) for source in sources},
        "weights": weights,
        "body": sha256(options.body) if options.body else None,
    }
    # Where files lie may change from run to run; what they hold is among the facts.
    text = json.dumps(facts, sort_keys=True, default=lambda path: path.name)
    return hashlib.sha256(text.encode()).hexdigest()
