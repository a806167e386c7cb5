"""Published protocols of sets, GENEA's encoder, and how much a rule alone changes a number."""

import json
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import nn

from app.commands.cli import main
from app.errors import RunError
from app.run.batch.leaderboard import entries_from_results, leaderboard_page_html
from app.run.batch.motion_sets import diagnose_folders
from app.run.requests.convert import replace_fields
from app.run.requests.parts import MetricOptions, parse_expected
from app.run.requests.requests import AnyRun
from model.metrics.protocols.clip import ProtocolInputs
from model.metrics.protocols.formulas import protocol_sums, protocol_values
from model.metrics.protocols.table import PROTOCOLS
from model.motion.kinematics import open_body_skeleton
from model.motion.motion import Motion, save_motion
from model.motion.tracks import track_points
from model.speech.audio import write_wav
from model.storage.cards import CheckpointError
from model.systems.helpers.genea import genea_codes, load_genea_encoder
from tests.app.requests import diagnose_request
from tests.helpers import csv_rows, smooth_motion_example

FRAMES = {"a": 340, "b": 420}
SYSTEMS = {"lively": 1.5, "calm": 0.8}
FLAT = {30: 320, 60: 800, 90: 1280}
"""Size of the flattened output of GENEA's convolutions by the length of pieces."""


def _motions(clip: str) -> dict[str, Motion]:
    recorded = smooth_motion_example(FRAMES[clip], ord(clip))
    return {"reference": recorded} | {
        name: replace(recorded, poses=(size * recorded.poses).astype(np.float32))
        for name, size in SYSTEMS.items()
    }


@pytest.fixture(scope="module")
def genea(tmp_path_factory: pytest.TempPathFactory) -> dict[int, Path]:
    """Files of GENEA's shape by the length of their pieces, of seeded numbers."""
    folder = tmp_path_factory.mktemp("genea")
    return {length: _genea_file(folder, length) for length in FLAT}


def _genea_file(folder: Path, length: int) -> Path:
    torch.manual_seed(0)
    network = nn.Module()
    network.add_module("pose_encoder", _genea_network(length))
    network.add_module("decoder", nn.Linear(2, 2))
    path = folder / f"model_checkpoint_{length}.bin"
    torch.save({"pose_dim": 42, "n_frames": length, "gen_dict": network.state_dict()}, path)
    return path


def _genea_network(length: int) -> nn.Module:
    """The encoder as the public scripts build it, with a slope of 1 in its linear layers."""
    network = nn.Module()

    def layer(a: int, b: int, width: int, stride: int) -> nn.Sequential:
        return nn.Sequential(nn.Conv1d(a, b, width, stride), nn.BatchNorm1d(b), nn.LeakyReLU(0.2))

    network.net = nn.Sequential(
        layer(42, 32, 3, 1), layer(32, 64, 3, 1), layer(64, 64, 4, 2), nn.Conv1d(64, 32, 3)
    )
    network.out_net = nn.Sequential(
        *(nn.Linear(FLAT[length], 256), nn.BatchNorm1d(256), nn.LeakyReLU(1.0)),
        *(nn.Linear(256, 128), nn.BatchNorm1d(128), nn.LeakyReLU(1.0), nn.Linear(128, 32)),
    )
    for module in network.modules():
        if isinstance(module, nn.BatchNorm1d):
            module.running_mean = torch.randn(module.num_features)
            module.running_var = torch.rand(module.num_features) + 0.5
    return network.eval()


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory, genea: dict[int, Path]) -> AnyRun:
    """Two systems and a recorded set of two clips, with sound, measured with expected values."""
    top = tmp_path_factory.mktemp("sets")
    rng = np.random.default_rng(1)
    for folder in (*SYSTEMS, "reference", "sound"):
        (top / folder).mkdir()
    for clip, frames in FRAMES.items():
        for name, motion in _motions(clip).items():
            save_motion(motion, top / name / f"{clip}.npz")
        clicks = rng.normal(0, 1, frames * 16000 // 30) * (rng.uniform(0, 1, 1) > 0)
        clicks *= (np.arange(len(clicks)) % 6000 < 300) * 0.3 + 0.001
        write_wav(top / "sound" / f"{clip}.wav", clicks.astype(np.float32))
    np.save(top / "speeds.npy", np.full(55, 0.2, np.float32))
    request = diagnose_request(
        motions=tuple(top / name for name in SYSTEMS),
        out=top / "out",
        reference=top / "reference",
        speech=top / "sound",
        mean_speeds=top / "speeds.npy",
        expected=parse_expected("beats/emage=.5, slide_m=.01,fgd=4.2"),
        genea_weights=tuple(genea.values()),
    )
    diagnose_folders(request)
    return request


def test_sets_have_rows_of_every_protocol_that_applies(results: AnyRun):
    rows = csv_rows(results.output.out / "batch.csv")
    published = {row["protocol"] for row in rows if row["measure"].startswith(row["protocol"])}
    assert published == {
        *("beats/emage", "beats/evaltools", "beats/raggesture", "physical/mbench", "gac/unicamp"),
        *("hellinger/genea", "cca/genea"),
    }
    assert {row["protocol"] for row in rows} - published == {
        *("workbench/1", "beats/workbench-emage", "l1div/emage", "fgd/workbench"),
        "fgd/genea-30",
    }
    slow = []
    for clip in FRAMES:
        motions = _motions(clip)
        tracks = {name: track_points(each, open_body_skeleton()) for name, each in motions.items()}
        inputs = ProtocolInputs()
        recorded = inputs.make_clip(motions["reference"], tracks["reference"])
        sums = protocol_sums(inputs.make_clip(motions["lively"], tracks["lively"], recorded))
        slow.append(protocol_values(sums)["gac/unicamp"]["dice"])
    mean, difference = (
        row for row in rows if row["measure"] == "gac/unicamp/dice" and row["system"] == "lively"
    )
    # Clips are cut to the shortest of a clip's motions only, and averaged alike.
    assert float(mean["mean"]) == pytest.approx(np.mean(slow), rel=1e-6)
    assert float(mean["low"]) <= float(mean["mean"]) <= float(mean["high"])
    assert difference["difference_to"] == "calm" and mean["unit"] == "0 to 1"
    assert {row["system"] for row in rows if row["measure"] == "physical/mbench/slide_m"} == {
        *SYSTEMS, "reference",
    }  # fmt: skip
    assert not any(row["system"] == "reference" for row in rows if "dice" in row["measure"])


def test_values_of_different_protocols_are_in_different_rows_of_tables(results: AnyRun):
    sheet = (results.output.out / "summary.md").read_text()
    assert "BeatAlign (0 to 1) · beats/workbench-emage |" in sheet
    for name in ("beats/emage", "beats/evaltools", "beats/raggesture"):
        assert f"| {name}/beat_align (0 to 1) |" in sheet
    lively, calm, *_ = entries_from_results(results.output.out)
    other = {key: replace(each, protocol="x/y") for key, each in calm.measures.items()}
    page = leaderboard_page_html([lively, replace(calm, measures=other)])
    assert page.count("Slide on the ground <small>cm/s</small>") <= 1
    assert "foot_sliding_cm_s · workbench/1" in page and "foot_sliding_cm_s · x/y" in page
    assert lively.measures["beats/emage/beat_align"].protocol == "beats/emage"
    assert "Protocol beats/emage." in leaderboard_page_html([lively, calm])


def _rule_rows(out: Path) -> dict[tuple[str, str, str], list[str]]:
    """Read cells of the table of rules, by metric, system and rule."""
    _, told = (out / "summary.md").read_text().split("The table shows how much the protocol alone")
    cells = [[cell.strip() for cell in line.split("|")[1:-1]] for line in told.splitlines()[2:]]
    return {(row[0], row[1], row[2]): row[3:] for row in cells if len(row) == 6}


def test_the_effect_of_the_rule_alone_is_told_next_to_expected_values(results: AnyRun):
    sheet = (results.output.out / "summary.md").read_text()
    assert "Expected: beats/emage 0.5, slide_m 0.01, fgd 4.2." in sheet
    by_rule = _rule_rows(results.output.out)
    plain = by_rule["slide_m", "lively", "physical/mbench"]
    still = by_rule["slide_m", "lively", "physical/mbench, without translation"]
    assert float(still[1]) == pytest.approx(float(still[0]) - float(plain[0]), abs=2e-3)
    assert float(plain[2]) == pytest.approx(float(plain[0]) - 0.01, abs=2e-3)
    pieces = by_rule["beats/emage", "calm", "beats/emage, first 10 s of each clip"]
    assert float(pieces[1]) != 0
    assert by_rule["beats/emage", "calm", "beats/emage, skeleton 10 % larger"][1] != ""
    # Protocols of one metric are compared without being asked for.
    assert {rule for metric, system, rule in by_rule if (metric, system) == ("beats", "calm")} > {
        *("beats/workbench-emage", "beats/emage", "beats/evaltools", "beats/raggesture"),
    }
    assert ("beats", "calm", "beats/emage, without translation") not in by_rule


def test_the_authors_zip_of_person_2_is_measured_next_to_ours(tmp_path: Path):
    ours, recorded = tmp_path / "ours", tmp_path / "smplxflame_30"
    ours.mkdir()
    recorded.mkdir()
    with zipfile.ZipFile(tmp_path / "best_pid_2.zip", "w") as archive:
        for number in (1, 2):
            clip = f"2_scott_0_{number}_{number}"
            motions = _motions("ab"[number - 1])
            save_motion(motions["reference"], recorded / f"{clip}.npz")
            save_motion(motions["calm"], ours / f"{clip}.npz")
            # The authors' script writes whole windows only: 60 frames and 52 for each further one.
            theirs = motions["lively"].part(slice(60 + 52 * 4))
            save_motion(theirs, tmp_path / "res.npz")
            archive.write(tmp_path / "res.npz", f"best_pid_2/res_{clip}.npz")
        archive.writestr("best_pid_2/record_2.txt", "0.5\n")
    save_motion(smooth_motion_example(50), recorded / "2_scott_0_3_3.npz")
    asked = [str(tmp_path / "best_pid_2.zip"), str(ours), "--reference", str(recorded)]
    assert main(["diagnose", *asked, "--processes", "1", "--out", str(tmp_path / "out")]) == 0
    told = json.loads((tmp_path / "out" / "batch.json").read_text())
    assert told["clips"] == ["2_scott_0_1_1", "2_scott_0_2_2"]
    dice = [row for row in told["measures"] if row["measure"] == "gac/unicamp/dice"]
    systems = [row["system"] for row in dice if not row["difference_to"]]
    assert systems[1] == "ours" and systems[0].startswith("best_pid_2") and len(systems) == 2
    frames = [
        json.loads((tmp_path / "out" / "clips" / f"{clip}.json").read_text())["frames"]
        for clip in told["clips"]
    ]
    assert frames == [268, 268]


def test_sums_are_kept_and_measured_again_if_values_are_expected(results: AnyRun):
    kept = results.output.out / "clips" / "a.sums.npz"
    with np.load(kept) as file:
        assert any(name.startswith("without translation|") for name in file.files)
    again = diagnose_folders(results)
    assert any("2 clips had already been measured" in note for note in again.notes)
    kept.unlink()
    again = diagnose_folders(replace_fields(results, expected=()))
    assert not any("had already been measured" in note for note in again.notes)
    with np.load(kept) as file:
        assert not any(name.startswith("without translation|") for name in file.files)


def test_unknown_expected_values_are_refused(tmp_path: Path, capsys):
    for text, told in (
        ("fgd", "must be METRIC=NUMBER, such as fgd=4.2; got 'fgd'"),
        ("fgd=x", "must be METRIC=NUMBER, such as fgd=4.2; got 'fgd=x'"),
        ("dy=1", "no metric"),
    ):
        with pytest.raises(RunError, match=told):
            parse_expected(text)
    motion = tmp_path / "a.npz"
    save_motion(smooth_motion_example(40), motion)
    asked = ["diagnose", str(motion), "--expect", "fgd=4.2", "--out", str(tmp_path / "out")]
    assert main(asked) == 1
    assert "--expect needs a folder of clips" in capsys.readouterr().err


@pytest.mark.parametrize(("length", "num_codes"), [(30, 11), (60, 5), (90, 3)])
def test_the_encoder_of_genea_gives_the_codes_of_the_public_network(
    genea: dict[int, Path], length: int, num_codes: int
):
    encoder, skeleton = load_genea_encoder(genea[length]), open_body_skeleton()
    assert encoder.length == length
    codes = genea_codes(encoder, smooth_motion_example(195), skeleton)
    assert codes.shape == (num_codes, 32)
    network = _genea_network(length)
    network.load_state_dict({
        key.removeprefix("pose_encoder."): each
        for key, each in torch.load(genea[length])["gen_dict"].items()
        if key.startswith("pose_encoder.")
    })  # fmt: skip
    pieces = torch.randn(3, length, 42)
    with torch.no_grad():
        wanted = network.out_net(network.net(pieces.transpose(1, 2)).flatten(1))
        torch.testing.assert_close(encoder(pieces), wanted)
    # The published loop leaves out the piece that ends with the clip.
    assert genea_codes(encoder, smooth_motion_example(length), skeleton).shape == (0, 32)


def test_distances_by_encoders_of_genea_are_protocols_of_their_own(
    results: AnyRun, genea: dict[int, Path]
):
    out = results.output.out
    rows = {
        row["measure"]: row["protocol"]
        for row in csv_rows(out / "batch.csv")
        if row["measure"].startswith("fgd_genea") and not row["difference_to"]
    }
    assert rows == {"fgd_genea_30": "fgd/genea-30"}
    notes = " ".join(diagnose_folders(results).notes)
    assert all(
        f"GENEA's encoder for {length}-frame windows was not" in notes for length in (60, 90)
    )
    encoders = json.loads((out / "batch.json").read_text())["provenance"]["encoders"]
    assert len(set(encoders.values())) == len(encoders) == 4
    told = _rule_rows(out)
    for rule in ("fgd/workbench", "fgd/genea-30"):
        for change in ("first 10 s of each clip", "sampled at 15 frames per second"):
            assert float(told["fgd", "calm", f"{rule}, {change}"][1]) != 0
    # Positions depend on the skeleton and rotations do not; without translation it is reversed.
    taller, still = "skeleton 10 % larger", "without translation"
    assert float(told["fgd", "calm", f"fgd/genea-30, {taller}"][1]) != 0
    assert float(told["fgd", "calm", f"fgd/workbench, {taller}"][1]) == 0
    assert float(told["fgd", "calm", f"fgd/genea-30, {still}"][1]) == 0
    assert float(told["fgd", "calm", f"fgd/workbench, {still}"][1]) != 0
    with pytest.raises(CheckpointError, match="second GENEA encoder for 30 frames"):
        diagnose_folders(replace_fields(results, genea_weights=(genea[30], genea[30])))


def test_files_that_are_not_geneas_are_refused(tmp_path: Path, genea: dict[int, Path]):
    tensors = torch.load(genea[30])["gen_dict"]
    wrong = {
        "missing": {key: each for key, each in tensors.items() if "net.2" not in key},
        "long": tensors | {"pose_encoder.out_net.0.weight": torch.zeros(256, 999)},
        "channels": tensors | {"pose_encoder.net.0.0.weight": torch.zeros(32, 57, 3)},
        "nan": tensors | {"pose_encoder.net.3.bias": torch.full((32,), torch.nan)},
    }
    for name, each in wrong.items():
        torch.save({"gen_dict": each}, tmp_path / f"{name}.bin")
        with pytest.raises(CheckpointError, match=name):
            load_genea_encoder(tmp_path / f"{name}.bin")


def test_protocols_are_listed_by_the_command(capsys):
    assert main(["protocols"]) == 0
    listed = capsys.readouterr().out
    assert all(f"\n{name}\n" in f"\n{listed}" for name in PROTOCOLS)
    assert main(["protocols", "--json"]) == 0
    records = json.loads(capsys.readouterr().out)
    assert [each["id"] for each in records] == list(PROTOCOLS)
    assert MetricOptions().expected == ()
