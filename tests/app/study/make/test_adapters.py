"""Configurations of other tools: their formats, and the same blind ids."""

import csv
import json
from pathlib import Path

import pytest

from app.study.design.blinding import Blinding, blind_lists, draw_blinding
from app.study.design.plan import Plan, read_plan
from app.study.design.trials import Design, make_design
from app.study.make.adapters import genea_tables, hemvip_config, jspsych_timeline
from tests.app.study.made_study import write_plan

SYSTEMS, CLIPS = ["localnet", "globalnet", "recorded"], ["kitchen", "garden"]


def design_of(folder: Path, settings: str) -> tuple[Plan, Design, Blinding]:
    plan = read_plan(write_plan(folder, SYSTEMS, CLIPS, settings))
    design = make_design(plan)
    return plan, design, draw_blinding(design)


def shown_in(design: Design, blinding: Blinding) -> list[tuple[str, list[str]]]:
    return [(trial, videos) for trial, videos in blind_lists(design, blinding)[0] if videos]


@pytest.mark.parametrize(
    ("protocol", "page_type", "per_trial"),
    [("pairwise", "videopc", 1), ("matched", "videopc", 1), ("ranking", "video", 3),
     ("rating", "video", 1)],
)  # fmt: skip
def test_hemvip_gets_pages_with_blind_conditions(
    tmp_path: Path, protocol: str, page_type: str, per_trial: int
) -> None:
    settings = f'protocol = "{protocol}"\nhosted_at = "https://host.org/study/"'
    plan, design, blinding = design_of(tmp_path, settings)
    shown = shown_in(design, blinding)
    config = hemvip_config(plan, shown)
    assert config.keys() == {"testname", "stopOnErrors", "remoteService", "pages"}
    first, *pages, last = config["pages"]
    assert (first["type"], last["type"]) == ("generic", "finish")
    assert {page["type"] for page in pages} == {page_type}
    assert len(pages) == per_trial * len(shown)
    known = set(blinding.videos.values())
    for page in pages:
        for name, address in page["stimuli"]:
            assert name in known
            assert address == f"https://host.org/study/media/{name}.mp4"


def test_genea_gets_pairs_and_mismatches(tmp_path: Path) -> None:
    plan, design, blinding = design_of(tmp_path, 'protocol = "pairwise"')
    (table,) = genea_tables(plan, design, blinding).values()
    header, *rows = csv.reader(table.splitlines())
    assert header == ["clip_name", "system_1", "system_2"]
    pairs = {frozenset(blinding.videos[s] for s in t.stimuli) for t in design.trials if t.stimuli}
    assert {frozenset(row[1:]) for row in rows} == pairs

    plan, design, blinding = design_of(tmp_path, 'protocol = "matched"')
    (table,) = genea_tables(plan, design, blinding).values()
    header, *rows = csv.reader(table.splitlines())
    assert header == ["clip_name", "system", "mismatch_type", "mismatch_data"]
    stimuli = {blind: stimulus for stimulus, blind in blinding.videos.items()}
    assert len(rows) == 6
    for _, right, kind, wrong in rows:
        assert kind == "speech"
        assert stimuli[right].speech == stimuli[right].clip != stimuli[wrong].speech

    plan, design, blinding = design_of(tmp_path, 'protocol = "ranking"')
    assert genea_tables(plan, design, blinding) == {}


@pytest.mark.parametrize("protocol", ["pairwise", "matched", "ranking", "rating"])
def test_jspsych_plays_every_video_before_it_asks(tmp_path: Path, protocol: str) -> None:
    plan, design, blinding = design_of(tmp_path, f'protocol = "{protocol}"')
    shown = shown_in(design, blinding)
    timeline = jspsych_timeline(plan, shown)
    assert timeline[0]["type"] == "jsPsychPreload"
    seen: set[str] = set()
    for trial in timeline[2:]:
        if trial["type"] == "jsPsychVideoButtonResponse":
            assert trial["response_allowed_while_playing"] is False
            seen.add(trial["data"]["video"])
        else:
            assert set(trial["data"]["shown"]) <= seen
    assert seen == {video for _, videos in shown for video in videos}


@pytest.mark.parametrize("protocol", ["pairwise", "matched", "ranking", "rating"])
def test_no_configuration_of_a_participant_names_a_system_or_clip(
    tmp_path: Path, protocol: str
) -> None:
    plan, design, blinding = design_of(tmp_path, f'protocol = "{protocol}"')
    shown = shown_in(design, blinding)
    text = json.dumps([hemvip_config(plan, shown), jspsych_timeline(plan, shown)])
    text += "".join(genea_tables(plan, design, blinding).values())
    assert not [name for name in (*SYSTEMS, *CLIPS) if name in text]
