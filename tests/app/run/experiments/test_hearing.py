"""What speech decides, from speeches and from anyone's motions."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from app.commands.cli import main
from app.errors import RunError
from app.run.experiments.hearing import HearingRequest, measure_hearing
from model.motion.motion import load_motion, save_motion
from model.speech.audio import write_wav
from renderer.video.encoder import read_facts
from tests.model.made import made_waveform
from tests.model.measures.test_hearing import motion_of

SYSTEMS = ("globaldiff/global", "gan/5")


@pytest.fixture(scope="module")
def speeches(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, ...]:
    folder = tmp_path_factory.mktemp("speeches")
    for seed, name in enumerate(("one", "two")):
        write_wav(folder / f"{name}.wav", made_waveform(16_000 * 4, seed))
    return tuple(sorted(folder.glob("*.wav")))


def test_each_speech_is_heard_with_each_seed(
    speeches: tuple[Path, ...], weights: Path, tmp_path: Path
) -> None:
    shares: list[float] = []
    hearing = measure_hearing(
        HearingRequest(tmp_path, speeches, ("globaldiff/global",), weights=weights), shares.append
    )
    assert shares == [0.0, 0.25, 0.5, 0.75, 1.0]
    names = sorted(path.name for path in hearing.files)
    assert names == [
        *(f"globaldiff-global__{stem}__{seed}.npz" for stem in ("one", "two") for seed in (0, 1)),
        *(f"hearing.{ending}" for ending in ("csv", "json", "pdf", "png", "svg")),
    ]
    (heard,) = hearing.systems
    assert heard.guidance == 2.5
    told = json.loads((tmp_path / "hearing.json").read_text())["globaldiff/global"]
    arms = told["parts"]["arms"]
    assert arms["by_speech"] == pytest.approx(arms["same_speech"] - arms["neither"])
    rows = list(csv.DictReader((tmp_path / "hearing.csv").open()))
    assert [row["part"] for row in rows] == ["arms", "head", "brows", "jaw"]
    assert float(rows[0]["by_noise"]) == pytest.approx(arms["by_noise"])
    assert np.asarray(Image.open(tmp_path / "hearing.png").convert("L")).std() > 10
    # What was generated is what a folder of anyone's motion would be, and gives the same numbers.
    again = measure_hearing(HearingRequest(tmp_path / "again", motions=_only_motions(tmp_path)))
    assert again.systems[0].parts == heard.parts
    assert again.systems[0].guidance is None


def _only_motions(folder: Path) -> Path:
    kept = folder / "motions"
    kept.mkdir()
    for path in folder.glob("*.npz"):
        path.rename(kept / path.name)
    return kept


def test_a_planted_ear_is_found_in_anyones_motion(tmp_path: Path, capsys) -> None:
    """One system whose arms speech decides, one that hears nothing."""
    (tmp_path / "motions").mkdir()
    for name, share in (("hears", 0.9), ("deaf", 0.0)):
        for speech in range(3):
            for seed in range(2):
                motion = motion_of(speech, seed, share)
                save_motion(motion, tmp_path / "motions" / f"{name}__s{speech}__{seed}.npz")
    out = tmp_path / "out"
    assert main(["hearing", str(tmp_path / "motions"), "--out", str(out)]) == 0
    told = json.loads((out / "hearing.json").read_text())
    assert told["hears"]["parts"]["arms"]["by_speech"] > 0.7
    assert told["deaf"]["parts"]["arms"]["by_speech"] < 0.2
    assert told["deaf"]["parts"]["arms"]["by_noise"] > 0.7
    shown = capsys.readouterr()
    assert "hears: speech decides" in shown.err
    assert shown.out.splitlines() == [
        str(out / f"hearing.{kind}") for kind in ("json", "csv", "png", "svg", "pdf")
    ]


def test_guidance_makes_two_speeches_differ_more(
    speeches: tuple[Path, ...], weights: Path, tmp_path: Path
) -> None:
    """The same noise: the stronger speech is heard, the less alike what it makes."""

    def apart(guidance: float) -> float:
        out = tmp_path / str(guidance)
        request = HearingRequest(
            out, speeches, ("globaldiff/global",), weights=weights, guidance=guidance
        )
        measure_hearing(request)
        one, two = (
            load_motion(out / f"globaldiff-global__{stem}__0.npz") for stem in ("one", "two")
        )
        return float(np.abs(one.poses - two.poses).mean())

    assert apart(0.0) < apart(1.0) < apart(4.0)


def test_speakers_are_compared_on_the_first_speech(
    speeches: tuple[Path, ...], weights: Path, tmp_path: Path, capsys
) -> None:
    """One asked for twice over is as lively as itself, and the first speech's own motion."""
    shares: list[float] = []
    request = HearingRequest(
        tmp_path, speeches, ("globaldiff/global",), weights=weights, speakers=("bob", "ann")
    )
    (heard,) = measure_hearing(request, shares.append).systems
    assert shares == pytest.approx([k / 8 for k in range(9)])
    assert heard.compared is not None
    told = json.loads((tmp_path / "hearing.json").read_text())["globaldiff/global"]["speakers"]
    assert told["calm"] == "bob" and told["calm_over_lively"] == heard.compared.calm_over_lively
    assert told["manner"]["by_speaker"] == heard.compared.manner.by_speaker
    assert "bob's wrists move" in heard.sentence()
    command = ["hearing", *map(str, speeches), "--out", str(tmp_path / "no"), "--speakers", "bob"]
    with pytest.raises(SystemExit):
        main(command)
    assert "two names, CALM,LIVELY; got 'bob'" in capsys.readouterr().err


@pytest.mark.gl
def test_bodies_are_drawn_under_either_speech(
    speeches: tuple[Path, ...], weights: Path, tmp_path: Path
) -> None:
    request = HearingRequest(
        tmp_path, speeches, ("globaldiff/global",), weights=weights, has_videos=True
    )
    measure_hearing(request)
    for stem in ("one", "two"):
        facts = read_facts(tmp_path / f"globaldiff-global__{stem}.mp4")
        assert facts.num_frames == 120
        assert facts.width > 2 * facts.height, "four bodies side by side"


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"speeches": ("one.wav",)}, "Two to 8 speeches are compared; got 1"),
        ({"speeches": ("a/one.wav", "b/one.wav")}, "one name"),
        ({"seeds": 1}, "2 to 8; got 1"),
        ({"systems": ()}, "One to"),
        ({"motions": Path("folder")}, "not both"),
        (
            {"motions": Path("folder"), "speeches": (), "systems": (), "has_videos": True},
            "tells no speakers and no sound",
        ),
    ],
)
def test_what_cannot_be_compared_is_told(changes: dict, sentence: str, tmp_path: Path) -> None:
    asked = {"speeches": ("one.wav", "two.wav"), "systems": SYSTEMS} | changes
    asked["speeches"] = tuple(map(Path, asked["speeches"]))
    with pytest.raises(RunError, match=sentence):
        HearingRequest(tmp_path, **asked)


@pytest.mark.parametrize(
    ("names", "sentence"),
    [
        (["what.npz"], "SYSTEM__SPEECH__SEED.npz"),
        (["a__one__0.npz", "a__one__1.npz"], "Two speeches and two noise seeds"),
        ([], "found 0"),
    ],
)
def test_a_folder_that_says_too_little_is_told(
    names: list[str], sentence: str, tmp_path: Path
) -> None:
    (tmp_path / "motions").mkdir()
    for number, name in enumerate(names):
        save_motion(motion_of(0, number, 0.5), tmp_path / "motions" / name)
    with pytest.raises(RunError, match=sentence):
        measure_hearing(HearingRequest(tmp_path / "out", motions=tmp_path / "motions"))
