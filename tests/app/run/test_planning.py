"""Plans: drawn by a run and by themselves, given back, and refused."""

import json
from pathlib import Path

import numpy as np
import pytest

from app.commands.cli import main
from app.errors import RunError
from app.run.generated_motions import write_plan_from_speech
from app.run.pipeline import run
from app.run.requests.convert import replace_fields
from app.run.requests.requests import GenerateRequest
from model.motion.motion import load_motion, save_motion
from model.plan.editing import add_gesture, gestures
from model.plan.files import read_plan_file, write_plan_file
from model.plan.plan import SIDES, Blink, GesturePlan, Nod, PlanError
from model.speech.audio import write_wav
from model.systems.planned.config import PLANNED
from tests.app.requests import generate_request, plan_request
from tests.model.made import made_waveform
from tests.model.plan.made import grid, tier
from tests.model.plan.test_detection import made_motion

STEM = "workbench-planned"
WORLD = "globaldiff/global"


@pytest.fixture
def asked(all_weights: Path, tmp_path: Path) -> GenerateRequest:
    speech = tmp_path / "speech.wav"
    write_wav(speech, made_waveform(16_000 * 4))
    return generate_request(
        speech=speech, out=tmp_path / "out", weights=all_weights, systems=(PLANNED,), steps=1,
        has_figures=False,
    )  # fmt: skip


def test_a_run_leaves_the_plan_that_it_performs_and_a_run_with_it_performs_the_same(
    asked: GenerateRequest, tmp_path: Path
) -> None:
    run(replace_fields(asked, samples=2))
    plans = sorted(asked.output.out.glob("*.plan.json"))
    assert [path.name for path in plans] == [f"{STEM}.plan.json", f"{STEM}.s2.plan.json"]
    assert read_plan_file(plans[0]).plan.duration_s == 4.0
    other = replace_fields(asked, out=tmp_path / "given", plan=plans[0], systems=(WORLD, PLANNED))
    given = run(other)
    assert f"{WORLD} does not use gesture plans; plan and style do not apply to it." in given.notes
    first, again = (load_motion(out / f"{STEM}.npz").poses for out in (asked.output.out, given.out))
    np.testing.assert_allclose(first, again, atol=2e-3)  # a file of plans has four decimals
    record = json.loads((given.out / "provenance.json").read_text())
    assert record["options"]["plan"] == f"{STEM}.plan.json"


def test_plans_and_styles_that_nobody_performs_or_reads_are_refused(
    asked: GenerateRequest, tmp_path: Path
) -> None:
    plan, style = tmp_path / "plan.json", tmp_path / "style.toml"
    write_plan_file(GesturePlan(4.0), plan)
    style.write_text("wrong_words = true")
    for changes in ({"plan": plan}, {"style": style}):
        words = f"None of these systems uses gesture plans; remove the {next(iter(changes))}"
        with pytest.raises(RunError, match=words):
            run(replace_fields(asked, systems=(WORLD,), **changes))
    plan.write_text("[]")
    with pytest.raises(PlanError, match="is not a plan of format 1"):
        run(replace_fields(asked, plan=plan))
    assert not asked.output.out.exists()


def test_an_annotators_plan_is_performed_and_what_was_made_of_it_is_told(
    asked: GenerateRequest, tmp_path: Path
) -> None:
    empty = tmp_path / "plan.eaf"
    nowhere = tmp_path / "no weights"
    made = write_plan_from_speech(
        plan_request(speech=asked.speech.path, out=empty, weights=nowhere, writes_empty_plan=True)
    ).plan
    assert made == GesturePlan(4.0) == read_plan_file(empty).plan
    assert 'RELATIVE_MEDIA_URL="./speech.wav"' in empty.read_text()
    grid_ = tmp_path / "plan.TextGrid"
    grid_.write_text(grid(tier("RH phase", (0, 1, "prep"), (1, 1.5, "stroke"))))
    given = run(replace_fields(asked, plan=grid_))
    assert any(note.startswith("The right hand has no goals") for note in given.notes)
    performed = read_plan_file(given.out / f"{STEM}.plan.json").plan
    assert [p.phase for p in performed.right] == ["preparation", "stroke"]


def test_a_plan_and_a_transcript_of_a_longer_clip_are_cut_and_told(
    asked: GenerateRequest, tmp_path: Path
) -> None:
    plan, said = tmp_path / "plan.json", tmp_path / "said.tsv"
    write_plan_file(GesturePlan(9.0, nods=(Nod(1.0, 4.0), Nod(8.0, 4.0))), plan)
    said.write_text("0.5\t1\tnow\n8\t8.5\tthen\n")
    given = run(replace_fields(asked, plan=plan, transcript=said))
    performed = read_plan_file(given.out / f"{STEM}.plan.json").plan
    assert performed.duration_s == 4.0 and [nod.time_s for nod in performed.nods] == [1.0]
    assert [word.text for word in given.transcript.words] == ["now"]
    for file, what in (("plan.json lasts 9.0", "The plan "), ("said.tsv ends at 8.5", "")):
        assert any(note.startswith(f"{what}{file}") for note in given.notes)
    told = json.loads((given.out / "diagnostics.json").read_text())
    assert [word["text"] for word in told["words"]] == ["now"]


def test_a_style_file_is_done_to_drawn_and_to_given_plans(
    asked: GenerateRequest, tmp_path: Path
) -> None:
    style, more, given = (tmp_path / name for name in ("style.toml", "more.toml", "given.json"))
    style.write_text("[times]\nsmile = 0\ngestures_per_min = 0\n")
    more.write_text("gestures_per_min = 90")
    write_plan_file(
        add_gesture(GesturePlan(4.0, right=(), left=()), "offer", 2.0, "right").plan, given
    )
    for plan in (None, given):
        made = run(replace_fields(asked, out=tmp_path / f"{plan is None}", plan=plan, style=style))
        performed = read_plan_file(made.out / f"{STEM}.plan.json").plan
        assert not [one for side in SIDES for one in gestures(performed, side)]
        record = json.loads((made.out / "provenance.json").read_text())
        assert record["options"]["style"] == "style.toml"
    made = run(replace_fields(asked, out=tmp_path / "more", plan=given, style=more))
    assert f"{PLANNED}: There is room for only 15 gestures per minute." in made.notes


def test_words_of_a_transcript_reach_the_plan(asked: GenerateRequest, tmp_path: Path) -> None:
    said, plan = tmp_path / "said.TextGrid", tmp_path / "plan.json"
    said.write_text(grid(tier("words", (0, 1.5, "So"), (1.5, 3, "whole"))))
    words: set[str] = set()
    for seed in range(6):
        one = plan_request(
            speech=asked.speech.path, out=plan, weights=asked.sampling.weights, seed=seed,
            speaker=asked.sampling.speaker, transcript=said,
        )  # fmt: skip
        words |= {p.word for side in SIDES for p in write_plan_from_speech(one).plan.hand(side)}
        if words > {""}:
            break
    assert words > {""} and words <= {"", "so", "whole"}


def test_files_for_3d_software_carry_the_plan_as_markers(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    motion, plan = tmp_path / "made.npz", tmp_path / "made.plan.json"
    save_motion(made_motion(90), motion)
    still = GesturePlan(3.0, nods=(Nod(1.5, 4.0),))
    write_plan_file(add_gesture(still, "offer", 2.0, "right").plan, plan)
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

    write_plan_file(GesturePlan(3.0, blinks=(Blink(1.0),)), tmp_path / "other.json")
    flags = ["--plan", str(tmp_path / "other.json"), "--out", str(tmp_path / "other.bvh")]
    assert main(["render", str(motion), *flags]) == 0
    assert (tmp_path / "other.markers.csv").read_text().splitlines()[1:] == ["30,1.0000,blink"]
    plan.unlink()
    assert main(["render", str(motion), "--out", str(tmp_path / "bare.bvh")]) == 0
    assert not (tmp_path / "bare.markers.csv").exists()


def test_the_command_draws_or_finds_a_plan_and_says_what_it_cannot(
    asked: GenerateRequest, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    motion, out, style = (tmp_path / name for name in ("still.npz", "found.eaf", "style.toml"))
    save_motion(made_motion(60), motion)
    style.write_text("[times]\ngestures_per_min = 0\n")

    def told(source: Path, out: Path, *flags: str, status: int = 0) -> str:
        argv = ["plan", str(source), "--out", str(out), *flags]
        assert main(argv) == status
        said = capsys.readouterr()
        return said.err if status else said.out.strip()

    assert told(motion, out) == str(out)
    found = read_plan_file(out).plan
    assert found.duration_s == 2.0 and found.left and found.right
    plan, weights = tmp_path / "plan.json", ("--weights", str(asked.sampling.weights))
    assert told(asked.speech.path, plan, "--speaker", "bob", *weights) == str(plan)
    assert gestures(read_plan_file(plan).plan, "right")
    told(asked.speech.path, plan, "--style", str(style), *weights)
    assert not gestures(read_plan_file(plan).plan, "right")

    many = ("--seed", "3", "--guidance", "0", "--channel", "left", "--words", "recognise")
    for flags, left_out in (
        (("--speaker", "bob"), "--speaker"),
        (("--empty",), "--empty"),
        (many, "--seed, --guidance, --channel and --words"),
    ):
        said = told(motion, out, *flags, status=1)
        named = said.removeprefix(
            "From a motion file, the plan is detected and not sampled; remove "
        )
        named = named.removesuffix(".\n")
        assert sorted(named.replace(" and", ",").split(", ")) == sorted(
            left_out.replace(" and", ",").split(", ")
        )
    motion.write_bytes(b"no")
    style.write_text("more = 1")
    for source, to, flags, words in (
        (motion, out, (), "still.npz"),
        (
            asked.speech.path,
            tmp_path / "plan.txt",
            (),
            "plan.txt has the wrong suffix; a plan file must end in",
        ),
        (asked.speech.path, plan, ("--guidance", "99"), "Guidance must be from 0 to 10; got 99."),
        (asked.speech.path, plan, ("--seed", "-1"), "must not be negative; got -1"),
        (
            asked.speech.path,
            plan,
            ("--empty", "--style", str(style)),
            "An empty plan cannot have a style",
        ),
        (asked.speech.path, plan, ("--empty", "--seed", "3"), "no plan is sampled; remove --seed"),
        (asked.speech.path, plan, ("--assume", "up=z"), "remove --assume"),
        (asked.speech.path, plan, ("--style", str(style), *weights), "'more' is not a style key"),
        (asked.speech.path, plan, ("--weights", str(tmp_path)), f"There is no system '{PLANNED}'"),
    ):
        assert words in told(source, to, *flags, status=1)
