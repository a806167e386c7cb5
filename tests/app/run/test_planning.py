"""Plans: drawn by a run and by themselves, given back, and refused."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.commands.cli import main
from app.errors import RunError
from app.run.pipeline import generate_all
from app.run.planning import PlanRequest, make_plan
from app.run.requests.request import GenerateRequest
from model.motion.motion import load_motion, save_motion
from model.plan.editing import added, gestures
from model.plan.files import read_plan_file
from model.plan.plan import SIDES, Blink, GesturePlan, Nod, PlanError, read_plan
from model.speech.audio import write_wav
from model.systems.planned.config import PLANNED
from tests.model.made import TINY_SYSTEMS, made_waveform, make_weights
from tests.model.plan.test_annotation import grid, interval_tier
from tests.model.plan.test_found import made_motion
from tests.model.systems.planned.made import make_planned_weights

STEM = "workbench-planned"


@pytest.fixture(scope="module")
def planning(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = make_weights(tmp_path_factory.mktemp("weights"), TINY_SYSTEMS)
    return make_planned_weights(folder)


@pytest.fixture
def request_(planning: Path, tmp_path: Path) -> GenerateRequest:
    speech = tmp_path / "speech.wav"
    write_wav(speech, made_waveform(16_000 * 4))
    return GenerateRequest(
        speech=speech, out=tmp_path / "out", weights=planning, systems=(PLANNED,), has_video=False,
        has_figures=False,
    )  # fmt: skip


def test_a_run_leaves_the_plan_that_it_performs_and_a_run_with_it_performs_the_same(
    request_: GenerateRequest, tmp_path: Path
) -> None:
    result = generate_all(replace(request_, samples=2))
    plans = [path for path in result.files if path.name.endswith(".plan.json")]
    assert [path.name for path in plans] == [f"{STEM}.plan.json", f"{STEM}.s2.plan.json"]
    assert read_plan(plans[0]).duration_s == 4.0
    given = generate_all(replace(request_, out=tmp_path / "given", plan=plans[0]))
    one, other = (load_motion(folder / f"{STEM}.npz").poses for folder in (request_.out, given.out))
    np.testing.assert_allclose(one, other, atol=2e-3)  # a file of plans has four decimals
    record = json.loads((given.out / "provenance.json").read_text())
    assert record["options"]["plan"] == f"{STEM}.plan.json"


def test_systems_that_perform_no_plans_say_so(request_: GenerateRequest, tmp_path: Path) -> None:
    plan = tmp_path / "plan.json"
    make_plan(PlanRequest(request_.speech, plan, request_.weights))
    asked = replace(request_, plan=plan, systems=("globaldiff/global", PLANNED))
    assert "globaldiff/global performs no plans." in generate_all(asked).notes
    with pytest.raises(RunError, match="None of these systems performs plans; leave the plan out"):
        generate_all(replace(asked, systems=("globaldiff/global",), out=tmp_path / "other"))
    plan.write_text("[]")
    with pytest.raises(PlanError, match="is no plan of format 1"):
        generate_all(replace(asked, out=tmp_path / "third"))


def test_an_annotators_plan_is_performed_and_what_was_made_of_it_is_told(
    request_: GenerateRequest, tmp_path: Path
) -> None:
    empty = tmp_path / "plan.eaf"
    asked = PlanRequest(request_.speech, empty, tmp_path / "no weights", is_empty=True)
    assert make_plan(asked).plan.duration_s == 4.0
    assert 'RELATIVE_MEDIA_URL="./speech.wav"' in empty.read_text()
    assert read_plan_file(empty).plan == make_plan(asked).plan
    grid_ = tmp_path / "plan.TextGrid"
    grid_.write_text(grid(interval_tier("RH phase", (0, 1, "prep"), (1, 1.5, "stroke"))))
    given = generate_all(replace(request_, plan=grid_))
    assert any(note.startswith("No places are told for the right hand") for note in given.notes)
    performed = read_plan(given.out / f"{STEM}.plan.json")
    assert [p.phase for p in performed.right] == ["preparation", "stroke"]


def test_words_of_a_transcript_reach_the_plan(request_: GenerateRequest, tmp_path: Path) -> None:
    said = tmp_path / "said.TextGrid"
    said.write_text(grid(interval_tier("words", (0, 1.5, "So"), (1.5, 3, "whole"))))
    plan = tmp_path / "plan.json"
    words: set[str] = set()
    for seed in range(6):
        asked = PlanRequest(request_.speech, plan, request_.weights, seed=seed, transcript=said)
        words |= {p.word for side in ("left", "right") for p in make_plan(asked).plan.hand(side)}
    assert words > {""} and words <= {"", "so", "whole"}


def test_a_style_file_is_done_to_drawn_and_to_given_plans(
    request_: GenerateRequest, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    style = tmp_path / "style.toml"
    style.write_text("[times]\nsmile = 0\ngestures_per_min = 0\n")
    still = GesturePlan(4.0, right=(), left=())
    given = tmp_path / "given.json"
    added(still, "offer", 2.0, "right").plan.write(given)
    for plan in (None, given):
        out = tmp_path / f"out {plan is None}"
        made = generate_all(replace(request_, out=out, plan=plan, style=style))
        performed = read_plan(out / f"{STEM}.plan.json")
        assert not [one for side in SIDES for one in gestures(performed, side)]
        record = json.loads((made.out / "provenance.json").read_text())
        assert record["options"]["style"] == "style.toml"
    with pytest.raises(RunError, match="None of these systems performs plans; leave the style out"):
        generate_all(replace(request_, style=style, systems=("globaldiff/global",)))

    out = tmp_path / "drawn.json"
    asked = ["plan", str(request_.speech), "--out", str(out), "--style", str(style)]
    assert main([*asked, "--weights", str(request_.weights)]) == 0
    assert not gestures(read_plan(out), "right")
    more = tmp_path / "more.toml"
    more.write_text("gestures_per_min = 90")
    made = generate_all(replace(request_, out=tmp_path / "more", plan=given, style=more))
    assert f"{PLANNED}: There is room for 15 gestures a minute." in made.notes
    assert main([*asked, "--empty"]) == 1
    assert "An empty plan has no style" in capsys.readouterr().err
    style.write_text("more = 1")
    assert main([*asked, "--weights", str(request_.weights)]) == 1
    assert "style.toml: a style has no 'more'" in capsys.readouterr().err


def test_files_for_3d_software_carry_the_plan_as_markers(
    request_: GenerateRequest, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    motion, plan = tmp_path / "made.npz", tmp_path / "made.plan.json"
    save_motion(made_motion(90), motion)
    still = GesturePlan(3.0, nods=(Nod(1.5, 4.0),))
    added(still, "offer", 2.0, "right").plan.write(plan)
    for ending in (".glb", ".bvh", ".blender.npz"):
        assert main(["render", str(motion), "--out", str(tmp_path / f"out{ending}")]) == 0
    assert str(tmp_path / "out.markers.csv") in capsys.readouterr().out.split()

    content = (tmp_path / "out.glb").read_bytes()
    length = int.from_bytes(content[12:16], "little")
    told = json.loads(content[20 : 20 + length])["animations"][0]["extras"]["markers"]
    assert {"time": 1.5, "frame": 45, "name": "nod 4°"} in told
    with np.load(tmp_path / "out.blender.npz", allow_pickle=False) as arrays:
        frames, names = arrays["marker_frames"].tolist(), arrays["marker_names"].tolist()
    assert frames == [marker["frame"] for marker in told]
    assert names == [marker["name"] for marker in told]
    assert "right stroke (offer)" in names
    lines = (tmp_path / "out.markers.csv").read_text().splitlines()
    assert lines[0] == "frame,time_s,name" and len(lines) == 1 + len(names)

    GesturePlan(3.0, blinks=(Blink(1.0),)).write(tmp_path / "other.json")
    flags = ["--plan", str(tmp_path / "other.json"), "--out", str(tmp_path / "other.bvh")]
    assert main(["render", str(motion), *flags]) == 0
    assert (tmp_path / "other.markers.csv").read_text().splitlines()[1:] == ["30,1.0000,blink"]
    plan.unlink()
    assert main(["render", str(motion), "--out", str(tmp_path / "bare.bvh")]) == 0
    assert not (tmp_path / "bare.markers.csv").exists()


def test_the_command_finds_the_plan_of_a_motion(
    request_: GenerateRequest, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    motion = tmp_path / "still.npz"
    save_motion(made_motion(60), motion)
    out = tmp_path / "found.eaf"
    assert main(["plan", str(motion), "--out", str(out)]) == 0
    assert capsys.readouterr().out.strip() == str(out)
    found = read_plan_file(out).plan
    assert found.duration_s == 2.0 and found.left and found.right
    for name, *value in (["--speaker", "bob"], ["--empty"]):
        assert main(["plan", str(motion), "--out", str(out), name, *value]) == 1
        refusal = f"In a motion the plan is found; {name} is for speech."
        assert refusal in capsys.readouterr().err
    motion.write_bytes(b"no")
    assert main(["plan", str(motion), "--out", str(out)]) == 1
    assert "still.npz" in capsys.readouterr().err


def test_the_command_draws_a_plan_alone(
    request_: GenerateRequest, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan = tmp_path / "plan.json"
    arguments = ["plan", str(request_.speech), "--out", str(plan), "--speaker", "bob"]
    assert main([*arguments, "--weights", str(request_.weights)]) == 0
    assert capsys.readouterr().out.strip() == str(plan)
    assert read_plan(plan).right
    assert main([*arguments[:3], str(tmp_path / "plan.txt")]) == 1
    assert "plan.txt ends in '.txt'; a plan is written as .json" in capsys.readouterr().err
    assert main([*arguments, "--weights", str(request_.weights), "--guidance", "99"]) == 1
    assert "Guidance must be 0 to 10; got 99." in capsys.readouterr().err
    assert main([*arguments, "--weights", str(request_.weights), "--seed", "-1"]) == 1
    assert main([*arguments, "--weights", str(tmp_path)]) == 1
    assert f"There is no system '{PLANNED}'" in capsys.readouterr().err
