"""What a run was asked for, in words."""

from pathlib import Path

from app.page.results.settings import differing, settings_of_own, settings_of_run
from app.run.diagnose import DiagnoseRequest
from app.run.requests.request import GenerateRequest


def asked(**changes) -> GenerateRequest:
    values = {"systems": ("globaldiff/local", "gan/5"), **changes}
    return GenerateRequest(Path("/up/talk.wav"), Path("out"), Path("weights"), **values)


def test_a_run_is_told_in_words() -> None:
    told = settings_of_run(
        asked(seed=3, steps={"globaldiff/local": 10}, sampler="heun", guidance=1.5)
    )
    assert told["strength of the speech"] == "1.5"
    assert (told["speech"], told["systems"], told["seed"]) == ("talk", "local, gan/5", "3")
    assert (told["steps"], told["filter"]) == ("local 10", "none")
    assert told["sampler"].startswith("Heun")
    assert told["followed point"] == "right middle fingertip"
    assert told["words"] == "none"
    assert settings_of_run(asked(words="recognise"))["words"] == "recognised"
    given = asked(words="recognise", transcript=Path("/up/said.txt"))
    assert settings_of_run(given)["words"] == "said.txt"


def test_only_what_differs_is_found() -> None:
    first, second = settings_of_run(asked(seed=3)), settings_of_run(asked(seed=7, steps=25))
    assert differing(first, second) == {"seed": ("3", "7"), "steps": ("usual", "25")}
    own = settings_of_own(DiagnoseRequest((Path("a.npz"),), Path("out"), names=("a",)))
    assert differing(first, own)["seed"] == ("3", "none") and "speech" not in differing(first, own)
