from dataclasses import replace
from pathlib import Path

import pytest

from app.config import AppConfig
from app.errors import RunError
from app.page.tabs.motion import Form, kept_values, request_from_form, row_names
from app.run.requests.display import Display
from app.run.requests.request import GenerateRequest
from tests.app import fakes

FORM = Form(
    speech="/speech.wav",
    systems=["globaldiff/global", "globaldiff/local"],
    speaker="scott",
    seed=3,
    samples=2,
    steps="7",
    sampler="heun",
    is_smoothed=True,
    reference="/reference.npz",
    point="left_index",
    start_frame=12,
    transcript="/said.txt",
    has_words=True,
    has_videos=False,
)
CONFIG = AppConfig(weights=Path("/weights"))


def read(form: Form) -> GenerateRequest:
    return request_from_form(form, Path("/job"), fakes.CATALOGUE, CONFIG)


def test_every_field_of_the_form_reaches_the_run() -> None:
    request = read(FORM)
    assert request == GenerateRequest(
        speech=Path("/speech.wav"),
        out=Path("/job/results"),
        weights=Path("/weights"),
        systems=("globaldiff/local", "globaldiff/global"),  # in the catalogue's order
        speaker="scott",
        seed=3,
        samples=2,
        steps=7,
        sampler="heun",
        post_filter="savgol",
        reference=Path("/reference.npz"),
        transcript=Path("/said.txt"),
        words="recognise",
        joint="left_index",
        start_frame=12,
        close_ups=("face", "hands"),
        size=640,
        display=Display(has_trail=True),
        has_video=False,
        has_poses=True,
        has_posters=True,
    )
    assert row_names(request) == (
        *("globaldiff/local", "globaldiff/local.s2"),
        *("globaldiff/global", "globaldiff/global.s2"),
        "reference",
    )


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"speech": None}, "no speech yet"),
        ({"systems": []}, "No system is chosen"),
        ({"systems": ["nonsense"]}, "no system 'nonsense'; the systems are globaldiff/local"),
        ({"seed": None}, "seed must be a whole number"),
        ({"seed": -1}, "got -1"),
        ({"seed": 1.5}, "got 1.5"),
        ({"seed": 2**31}, "got 2147483648"),
        ({"samples": 0}, "from 1 to 8; got 0"),
        ({"samples": 7}, "2 systems with 7 samples of each make 15 bodies"),
        ({"steps": "0"}, "must be 1 to 1000; got 0"),
        ({"steps": "many"}, "Steps are a number, or numbers by system"),
        ({"steps": "globaldiff/global=5,7"}, "Steps are a number, or numbers by system"),
        ({"start_frame": -1}, "got -1"),
        ({"start_frame": 0.5}, "got 0.5"),
        ({"sampler": "magic"}, "no sampler 'magic'"),
    ],
)
def test_a_form_that_cannot_be_done_gives_a_sentence(changes: dict, words: str) -> None:
    with pytest.raises(RunError, match=words):
        read(replace(FORM, **changes))


def test_steps_of_face_and_body_go_to_the_systems_that_have_them() -> None:
    catalogue = replace(fakes.CATALOGUE, with_face_steps=("globaldiff/global",))

    def asked(**fields: object) -> tuple[object, object]:
        form = replace(FORM, **fields)
        request = request_from_form(form, Path("/job"), catalogue, CONFIG)
        return request.steps, request.face_steps

    both = {"globaldiff/local": 7, "globaldiff/global": 9}
    assert asked() == (7, None)
    assert asked(body_steps=9.0, face_steps=3.0) == (both, {"globaldiff/global": 3})
    assert asked(steps="", body_steps=9) == ({"globaldiff/global": 9}, None)
    by_name = {"globaldiff/global": 5}
    assert asked(steps="globaldiff/global=5", body_steps=9) == (by_name, None)
    assert asked(steps="global=5", body_steps=9) == (by_name, None), "as the form calls it"


def test_the_strength_of_the_speech_is_each_systems_usual_one_or_what_is_chosen() -> None:
    assert read(FORM).guidance is None
    assert read(replace(FORM, guidance=2.5)).guidance == 2.5
    assert read(replace(FORM, guidance=1.0)).guidance == 1.0
    with pytest.raises(RunError, match="0 to 10; got 11"):
        read(replace(FORM, guidance=11.0))


def test_what_fills_the_form_in_again_is_all_but_files_that_a_run_does_not_show(
    tmp_path: Path,
) -> None:
    speech = tmp_path / "three reasons.wav"
    speech.write_bytes(b"RIFF")
    job = tmp_path / "job"
    job.mkdir()
    kept = kept_values(replace(FORM, speech=str(speech)), job)
    again = Path(kept.pop("speech"))
    assert again.name == speech.name and job in again.parents and again.read_bytes() == b"RIFF"
    again_asked = replace(FORM, reference=None, transcript=None)
    assert replace(Form(**{**kept, **dict.fromkeys(("speech", "reference", "transcript", "plan"))}),
                   speech=FORM.speech) == again_asked  # fmt: skip
