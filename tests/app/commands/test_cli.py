import contextlib
import io
import json
import re
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from app.commands.cli import main, make_parser
from app.flags import read_flags
from app.run.requests.display import Display
from app.run.requests.request import GenerateRequest
from app.run.videos.export import RenderRequest
from model.motion.motion import save_motion
from renderer.video.compose import band_height
from tests.helpers import ROOT, smooth_motion_example


def sentence_after(argv: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """Run a command that must fail; returns its one line on standard error."""
    assert main(argv) == 1
    shown = capsys.readouterr()
    assert shown.out == "" and shown.err.count("\n") == 1, shown
    return shown.err


def generate(speech: Path, out: Path, weights: Path, *flags: str) -> list[str]:
    common = ["--out", str(out), "--weights", str(weights), "--steps", "1", "--no-video"]
    return ["generate", str(speech), *common, *flags]


SIZES_REFUSED = ("254", "1082", "333", "0", "-512", "big")


@pytest.mark.parametrize("command", [[], ["generate"], ["render"], ["diagnose"], ["doctor"]])
def test_every_command_has_help(command: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as left:
        main([*command, "--help"])
    assert left.value.code == 0
    assert "usage: python -m app" in capsys.readouterr().out


@pytest.mark.parametrize(
    "argv",
    [
        [],
        ["nonsense"],
        ["generate"],
        ["generate", "a.wav", "--out", "o", "--post-filter", "blur"],
        ["generate", "a.wav", "--out", "o", "--views", "top"],
        ["generate", "a.wav", "--out", "o", "--systems", ","],
        ["generate", "a.wav", "--out", "o", "--seed", "x"],
        ["generate", "a.wav", "--out", "o", "--size", "64"],
        ["render", "a.npz"],
        *(["render", "a.npz", "--out", "a.mp4", "--size", size] for size in SIZES_REFUSED),
        ["render", "a.npz", "--out", "a.png", "--background", "green"],
        ["render", "a.npz", "--out", "a.png", "--look", "tall-light"],
        ["generate", "a.wav", "--out", "o", "--look", "clay"],
    ],
)
def test_wrong_arguments_exit_with_2(argv: list[str]) -> None:
    with pytest.raises(SystemExit) as left:
        main(argv)
    assert left.value.code == 2


def test_generate_lists_its_files_on_standard_output(
    speech: Path, weights: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert main(generate(speech, out, weights, "--systems", "globaldiff/global")) == 0
    listed = [Path(line) for line in capsys.readouterr().out.splitlines()]
    assert sorted(listed) == sorted(out.iterdir())
    assert out / "globaldiff-global.npz" in listed
    assert out / "globaldiff-local.npz" not in listed


def test_generate_follows_another_point_and_takes_words(
    speech: Path, weights: Path, tmp_path: Path
) -> None:
    out, words = tmp_path / "out", tmp_path / "speech.TextGrid"
    words.write_text(
        'File type = "ooTextFile"\nObject class = "TextGrid"\nitem [1]:\n'
        'class = "IntervalTier"\nname = "words"\nintervals [1]:\nxmin = 0.1\nxmax = 0.4\n'
        'text = "hello"\n'
    )
    argv = generate(
        speech, out, weights, "--joint", "left_wrist", "--start", "5", "--transcript", str(words)
    )
    assert main(argv) == 0
    found = json.loads((out / "diagnostics.json").read_text())
    assert found["joint"] == "left_wrist"
    assert found["words"] == [{"start_s": 0.1, "end_s": 0.4, "text": "hello", "confidence": 1.0}]
    assert found["words_origin"] == "given" and "phones" not in found
    provenance = json.loads((out / "provenance.json").read_text())
    assert provenance["options"]["transcript"] == "speech.TextGrid"
    assert provenance["speech"]["words"] == {"origin": "given", "count": 1}


def test_generate_refuses_a_transcript_that_is_none(
    speech: Path, weights: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    argv = generate(speech, tmp_path / "out", weights, "--transcript", str(speech))
    assert "speech.wav is no text" in sentence_after(argv, capsys)
    assert not (tmp_path / "out").exists()


def test_bad_speech_gives_its_sentence_and_nothing_else(
    bad_speech: tuple[Path, str],
    weights: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    speech, words = bad_speech
    out = tmp_path / "out"
    assert words in sentence_after(generate(speech, out, weights), capsys)
    assert not out.exists()


def test_a_bad_reference_gives_its_sentence(
    bad_motion: tuple[Path, str],
    speech: Path,
    weights: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    motion, words = bad_motion
    out = tmp_path / "out"
    argv = generate(speech, out, weights, "--reference", str(motion))
    assert words in sentence_after(argv, capsys)
    assert not out.exists()


@pytest.mark.parametrize("command", ["diagnose", "render"])
def test_a_bad_motion_file_gives_its_sentence(
    command: str, bad_motion: tuple[Path, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    motion, words = bad_motion
    out = tmp_path / ("out" if command == "diagnose" else "out.mp4")
    assert words in sentence_after([command, str(motion), "--out", str(out)], capsys)
    assert not out.exists()


def test_sound_that_can_be_used_is_used_and_what_was_done_to_it_is_said(
    eight_channels: Path,
    cut_mp3: Path,
    weights: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(generate(eight_channels, tmp_path / "a", weights)) == 0
    said = capsys.readouterr().err
    assert "8 channels" in said and "96,000 Hz" in said
    assert main(generate(cut_mp3, tmp_path / "b", weights)) == 0
    assert "damaged or cut off" in capsys.readouterr().err


def test_a_limit_on_length_can_be_raised(
    speech: Path, weights: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    argv = generate(speech, tmp_path / "a", weights, "--max-minutes", "0.01")
    assert "longer than 0.6 seconds" in sentence_after(argv, capsys)
    assert main(generate(speech, tmp_path / "b", weights, "--max-minutes", "20")) == 0


def test_a_folder_that_cannot_be_written_gives_its_sentence(
    speech: Path, weights: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("")
    argv = generate(speech, tmp_path / "file" / "out", weights)
    assert "cannot be written to" in sentence_after(argv, capsys)


def run_cli(argv: list[str], **kwargs) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "app", *argv],
        cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **kwargs,
    )  # fmt: skip


def test_a_file_that_may_not_grow_gives_its_sentence(
    speech: Path, weights: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))

    child = run_cli(generate(speech, out, weights), preexec_fn=limit)
    shown, said = child.communicate(timeout=100)
    assert child.returncode == 1 and shown == ""
    assert "is full; free some space" in said and "Traceback" not in said
    assert not out.exists()


@pytest.mark.gl
def test_a_terminated_run_leaves_no_file(speech: Path, weights: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    argv = ["generate", str(speech), "--out", str(out), "--weights", str(weights)]
    child = run_cli(argv)
    deadline = time.monotonic() + 60
    while not list(out.glob(".unfinished*/*.npz")) and time.monotonic() < deadline:
        time.sleep(0.02)
    child.send_signal(signal.SIGTERM)
    _, said = child.communicate(timeout=60)
    assert child.returncode == 1 and "stopped" in said and "Traceback" not in said
    assert not out.exists()


@pytest.fixture
def motion(tmp_path: Path) -> Path:
    path = tmp_path / "clip.npz"
    save_motion(smooth_motion_example(40), path)
    return path


def render(motion: Path, out: Path, *flags: str) -> list[Path]:
    """Files that the command lists, drawn small and fast."""
    argv = ["render", str(motion), "--out", str(out), "--size", "256", "--draft", *flags]
    with contextlib.redirect_stdout(io.StringIO()) as listed:
        assert main(argv) == 0
    return [Path(line) for line in listed.getvalue().splitlines()]


@pytest.mark.gl
def test_a_png_is_a_sheet_of_poses_over_their_times(motion: Path, tmp_path: Path) -> None:
    out = tmp_path / "sheet.png"
    assert render(motion, out) == [out]
    picture = np.asarray(Image.open(out)).astype(int)
    rows, columns, height = 2, 4, 256 + band_height(256)
    assert picture.shape == (rows * height, columns * 256, 3)
    for row in range(rows):
        for column in range(columns):
            tile = picture[row * height : (row + 1) * height, column * 256 : (column + 1) * 256]
            assert tile[:256].std() > 5, "an empty picture"
            assert tile[256:].max() == 255 and tile[256:].min() < 120, "no time"


@pytest.mark.gl
def test_stills_and_a_sheet_beside_a_video_and_for_each_view(motion: Path, tmp_path: Path) -> None:
    files = render(
        *(motion, tmp_path / "a.mp4", "--stills", "2", "--sheet", "20", "--views", "front,side")
    )
    assert [path.name for path in files] == [
        *("a.mp4", "a.1.png", "a.2.png", "a.sheet.png"),
        *("a.side.mp4", "a.side.1.png", "a.side.2.png", "a.side.sheet.png"),
    ]
    assert sorted(files) == sorted(p for p in tmp_path.iterdir() if p.name.startswith("a."))
    front, side = (np.asarray(Image.open(tmp_path / f"a{v}.1.png")) for v in ("", ".side"))
    assert front.shape == side.shape == (256, 256, 3) and (front != side).any()
    assert Image.open(tmp_path / "a.sheet.png").size[0] == 2 * 256


@pytest.mark.gl
def test_a_transparent_still_shows_the_body_and_nothing_else(motion: Path, tmp_path: Path) -> None:
    out = tmp_path / "still.png"
    assert render(motion, out, "--stills", "1", "--background", "transparent") == [out]
    picture = np.asarray(Image.open(out))
    assert picture.shape == (256, 256, 4)
    assert 0.03 < (picture[..., 3] == 255).mean() < 0.5
    assert (picture[:8, :, 3] == 0).all()


@pytest.mark.gl
def test_a_look_is_drawn_and_exported(motion: Path, tmp_path: Path) -> None:
    """A blue shirt, and the colour of clay; of one shape, and of another."""
    blue = {}
    for look in ("average-light", "average-clay"):
        out = tmp_path / f"{look}.png"
        render(motion, out, "--stills", "1", "--background", "transparent", "--look", look)
        red_green_blue = np.asarray(Image.open(out))[..., :3].reshape(-1, 3).astype(int)
        shown = red_green_blue[np.asarray(Image.open(out))[..., 3].ravel() == 255]
        blue[look] = np.mean(shown[:, 2] > shown[:, 0] + 20)
    assert blue["average-light"] > 0.2 and blue["average-clay"] == 0
    usual, broad = tmp_path / "usual.glb", tmp_path / "broad.glb"
    render(motion, usual)
    render(motion, broad, "--look", "broad-light")
    assert usual.read_bytes() != broad.read_bytes()


@pytest.mark.gl
def test_a_sheet_of_too_many_pictures_says_what_would_do(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "long.npz"
    save_motion(smooth_motion_example(130), path)
    argv = ["render", str(path), "--out", str(tmp_path / "a.png"), "--sheet"]
    assert "--sheet 3 or more" in sentence_after([*argv, "2"], capsys)
    assert not (tmp_path / "a.png").exists()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"trans": np.full((40, 3), np.nan)}, "not finite"),
        ({"trans": np.linspace((500.0,) * 3, (500.2,) * 3, 40)}, "500 m away; at most 100 m"),
        ({"poses": np.zeros((0, 165)), "trans": np.zeros((0, 3))}, "no frames"),
    ],
)
def test_motion_that_nothing_can_show_gives_its_sentence(
    motion: Path, tmp_path: Path, changes: dict, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with np.load(motion) as data:
        arrays = dict(data)
    np.savez(tmp_path / "bad.npz", **{**arrays, **changes})
    for name in ("a.mp4", "a.png", "a.glb", "a.bvh", "a.blender.npz"):
        argv = ["render", str(tmp_path / "bad.npz"), "--out", str(tmp_path / name)]
        assert words in sentence_after(argv, capsys)
        assert not (tmp_path / name).exists()


def test_without_an_encoder_a_video_gives_its_sentence(
    motion: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", "/nowhere/ffmpeg")
    argv = ["render", str(motion), "--out", str(tmp_path / "a.mp4"), "--size", "256"]
    assert "/nowhere/ffmpeg is no ffmpeg" in sentence_after(argv, capsys)
    assert not (tmp_path / "a.mp4").exists()


def test_what_the_blender_add_on_needs_is_there_without_pickles(
    motion: Path, tmp_path: Path
) -> None:
    out = tmp_path / "clip.blender.npz"
    assert render(motion, out) == [out]
    original = smooth_motion_example(40)
    with np.load(out, allow_pickle=False) as data:
        # As the add-on reads them.
        assert str(data["gender"]) == "neutral" and str(data["surface_model_type"]) == "smplx"
        assert int(data["mocap_frame_rate"]) == 30
        np.testing.assert_array_equal(data["poses"], original.poses)
        np.testing.assert_array_equal(data["trans"], original.trans)
        assert data["betas"].shape == (10,) and data["poses"].shape == (40, 165)
        parts = ("root_orient", "pose_body", "pose_jaw", "pose_eye", "pose_hand")
        joined = np.concatenate([data[part] for part in parts], axis=1)
        np.testing.assert_array_equal(joined, original.poses)


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        (["--out", "/nowhere/a.mp4"], "folder /nowhere does not exist"),
        (["--out", "a.gif"], "must end in one of .mp4, .png, .glb, .bvh, .blender.npz"),
        (["--out", "a.npz"], "must end in one of .mp4, .png, .glb, .bvh, .blender.npz"),
        (["--out", "a.png", "--stills", "0"], "1 to 64; got 0"),
        (["--out", "a.png", "--stills", "65"], "1 to 64; got 65"),
        (["--out", "a.png", "--sheet", "0"], "got one in 0"),
        (["--out", "a.glb", "--stills", "2"], "A .glb file holds no pictures"),
        (["--out", "a.bvh", "--sheet", "2"], "A .bvh file holds no pictures"),
        (
            ["--out", "a.mp4", "--background", "transparent"],
            "A .mp4 file cannot have",
        ),
        (
            ["--out", "a.glb", "--background", "transparent"],
            "A .glb file cannot have",
        ),
        (["--out", "a.mp4", "--speech", "/nowhere.wav"], "no speech file at /nowhere.wav"),
        (["--out", "a.mp4", "--body", "/nowhere.npz"], "nowhere.npz"),
    ],
)
def test_render_says_what_it_cannot_do(
    motion: Path, flags: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert words in sentence_after(["render", str(motion), *flags], capsys)


def test_doctor_finds_what_is_missing(
    weights: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status = main(["doctor", "--weights", str(tmp_path)])
    shown = capsys.readouterr()
    assert status == 1
    assert "NO  weights" in shown.out and "--weights DIR" in shown.out and "weights" in shown.err
    main(["doctor", "--weights", str(weights)])
    shown = capsys.readouterr().out
    assert "ok  weights" in shown
    assert re.search(r"ok +without OpenGL +compiled loops.* \d+ ms a picture of 512 x 512", shown)
    assert len(re.findall(r", used$", shown, re.MULTILINE)) == 1


def test_what_videos_show_is_asked_for_by_flags() -> None:
    parse = make_parser().parse_args
    usual = parse(["generate", "a.wav", "--out", "x"])
    assert (usual.close_ups, usual.framing) == (("hands",), "knees")
    assert read_flags(GenerateRequest, usual).display == Display()
    asked = parse(
        "render a.npz --out x.mp4 --close-up hands,face --framing knees "
        "--exaggerate 20 --trail --color jerk".split()
    )
    assert (asked.close_ups, asked.framing) == (("hands", "face"), "knees")
    assert read_flags(RenderRequest, asked).display == Display(20, True, "jerk")
    assert parse(["generate", "a.wav", "--out", "x", "--close-up", "off"]).close_ups == ()


@pytest.mark.parametrize("flags", [["--close-up", "feet"], ["--exaggerate", "7"]])
def test_what_videos_cannot_show_is_refused(flags: list[str]) -> None:
    with pytest.raises(SystemExit):
        make_parser().parse_args(["render", "a.npz", "--out", "x.mp4", *flags])


def test_what_a_file_of_3d_software_cannot_hold_is_refused(
    motion: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    argv = ["render", str(motion), "--out", str(tmp_path / "a.glb"), "--exaggerate", "5"]
    assert main(argv) == 1
    assert "holds the motion as it is" in capsys.readouterr().err
