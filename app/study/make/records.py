"""What the researcher keeps besides the key: manifest, provenance, draft of a pre-registration."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from app.run.models import get_body, get_system
from app.run.output.provenance import describe_systems, versions
from app.study.design.blinding import Blinding, blind_lists
from app.study.design.plan import Plan, questions_of
from app.study.design.trials import Balance, Design, measure_balance
from app.study.make import media
from app.study.make.motions import Source
from app.study.make.workspace import ExportOptions, Workspace
from model.storage.harmless import markdown


def write_records(
    plan: Plan,
    design: Design,
    blinding: Blinding,
    sources: Sequence[Source],
    options: ExportOptions,
    workspace: Workspace,
) -> None:
    """Write ``manifest.json``, ``provenance.json`` and ``preregistration.md``."""
    balance = reached_balance(design, blinding)
    manifest = {
        "study": blinding.study,
        "title": plan.title,
        "protocol": plan.protocol,
        "clips": {
            source.clip.name: {
                "speech": source.clip.speech.name if source.clip.speech else None,
                "start_s": source.clip.start_s,
                "frames": source.num_frames,
            }
            for source in sources
        },
        "videos": {
            blind: {**asdict(stimulus), "bytes": workspace.video(blind).stat().st_size}
            for stimulus, blind in sorted(blinding.videos.items(), key=lambda item: item[1])
        },
        "lists": {
            str(number): [{"trial": trial, "shown": shown} for trial, shown in pages]
            for number, pages in enumerate(blind_lists(design, blinding))
        },
        "balance": asdict(balance),
    }
    workspace.write_json(workspace.private / "manifest.json", manifest)
    workspace.write_json(workspace.private / "provenance.json", _provenance(plan, sources, options))
    draft = preregistration(plan, design, balance)
    workspace.write_text(workspace.private / "preregistration.md", draft)


def reached_balance(design: Design, blinding: Blinding) -> Balance:
    """The balance of the lists as they are; conditions of matched studies are told apart."""
    is_matched = any(trial.kind == "match" for trial in design.trials)
    system_of = {
        blind: (
            f"{stimulus.system} ({'matched' if stimulus.speech == stimulus.clip else 'mismatched'})"
            if is_matched
            else stimulus.system
        )
        for stimulus, blind in blinding.videos.items()
    }
    return measure_balance(blind_lists(design, blinding), system_of)


def _provenance(plan: Plan, sources: Sequence[Source], options: ExportOptions) -> dict[str, Any]:
    names = {system.generator.system for system in plan.systems if system.generator is not None}
    body = get_body(options.body)
    return {
        "made_at": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "versions": versions(),
        "weights": describe_systems([get_system(name, options.weights) for name in sorted(names)]),
        "systems": {
            system.name: {
                "generator": asdict(system.generator) if system.generator else None,
                "motions": _file_names(system.motions),
                "plans": _file_names(system.plans),
            }
            for system in plan.systems
        },
        "files_sha256": {source.clip.name: dict(source.files) for source in sources},
        "drawing": {
            "body": body.name,
            "body_sha256": body.sha256,
            "views": list(plan.views),
            "size": plan.size,
            "face": plan.face,
        },
        "encoding": {
            "bits_per_second": media.bit_rate(plan.size),
            "loudness_lufs": media.TARGET_LUFS if plan.has_sound else None,
        },
    }


def _file_names(motions: Any) -> dict[str, str] | None:
    return None if motions is None else {clip: Path(path).name for clip, path in motions.items()}


def preregistration(plan: Plan, design: Design, balance: Balance) -> str:
    """A draft to be completed before the first participant; what the plan says is filled in."""
    num_trials = sum(trial.kind != "attention" for trial in design.trials)
    per_person = len(design.lists[0]) - plan.attention_checks
    questions = "\n".join(f"- `{q.id}` ({q.kind}): {q.text}" for q in questions_of(plan.protocol))
    sound = "; each speech is one sound stream of -23 LUFS" if plan.has_sound else ""
    shares = ", ".join(
        f"{markdown(name)} {share:.3f}" for name, share in balance.first_place_shares.items()
    )
    return f"""# Pre-registration (draft): {markdown(plan.title)}

Complete the parts in brackets before the first participant starts.

## Hypotheses

[State for each pair of systems which is expected to be preferred, and why.]

## Design

- Protocol: {plan.protocol}{"" if plan.has_sound else ", videos without sound"}.
- Systems: {", ".join(markdown(system.name) for system in plan.systems)}.
- Clips: {", ".join(markdown(clip.name) for clip in plan.clips)}; views: {", ".join(plan.views)}.
- Participants: {plan.participants}; each sees {per_person} of {num_trials} trials and
  {plan.attention_checks} attention checks.
- Order: rows of a Williams square; counts of trials differ by at most
  {balance.position_spread} over places, {balance.follows_spread} over successions and
  {balance.appearances_spread} over lists.
- Side: share of first (left) places by condition: {shares}.
- All videos of a clip have the same body, camera, light, floor, length and number of
  bytes{sound}.

## Questions

{questions}

## Exclusion

A participant who fails more than {plan.max_failed} of the attention checks is left out. [Any
further rule.]

## Analysis

`python -m app study analyse`: shares of preference with Clopper-Pearson intervals, exact tests with
Holm's correction at 0.05, Bradley-Terry strengths with a bootstrap over participants. [Name the
primary comparison, and the smallest effect of interest.]

## Stopping

Data collection ends with {plan.participants} complete answers. [Any other rule.]
"""
