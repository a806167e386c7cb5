"""The command line: what it takes, lists, says and leaves."""

import contextlib
import io
import json
import os
import re
import resource
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from app.commands import doctor
from app.commands.cli import COMMANDS, main, parse
from app.run.display import Display
from model.motion.motion import save_motion
from model.plan.annotation_files import Interval, NamedTier, format_textgrid
from renderer.video.compose import label_band_height
from tests.helpers import ROOT, smooth_motion_example

FRAMES = 16


def sentence_after(argv: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """Run a command that must fail; returns its one line on standard error."""
    assert main(argv) == 1
    shown = capsys.readouterr()
    assert shown.out == "" and shown.err.count("\n") == 1, shown
    return shown.err


def generate(speech: Path, out: Path, weights: Path, *flags: str) -> list[str]:
    common = ["--out", str(out), "--weights", str(weights), "--steps", "1", "--no-video"]
    return ["generate", str(speech), *common, "--no-figures", *flags]


def test_wrong_arguments_exit_with_2_and_one_sentence(capsys):
    for command, words in [
        ("", "A command is missing. The commands are: generate, diagnose, "),
        ("nonsense", "There is no command 'nonsense'. The commands are: generate, "),
        (
            "study nonsense",
            "no command 'study nonsense'. The commands are: study export, ",
        ),
        ("generate --out o", "Missing: SPEECH"),
        ("generate a.wav", "Missing: --out"),
        ("generate a.wav --out o --post-filter blur", "'blur'"),
        (
            "generate a.wav --out o --views top",
            "--views: there is no view 'top'; choose from front, ",
        ),
        ("generate a.wav --out o --seed 1.5", "--seed: '1.5' is not a whole number."),
        ("generate a.wav --out o --guidance x", "--guidance: 'x' is not a number."),
        ("generate a.wav --out o --look clay", "'clay' is not one of average-light, "),
        ("generate a.wav --out o --systems ,", "--systems: give at least one name"),
        ("generate a.wav --out o --seeed 1", "There is no --seeed, 1; did you mean --seed?"),
        ("render a.npz", "--out"),
        (
            "render a.npz --out a.mp4 --size 254",
            "an even number of pixels from 256 to 1080; got 254",
        ),
        ("render a.npz --out a.mp4 --size big", "'big' is not a number of pixels"),
        ("render a.npz --out a.png --background green", "'green'"),
        ("render a.npz --out a.mp4 --close-up feet", "no close-up 'feet'"),
        ("render a.npz --out a.mp4 --exaggerate 7", "'7' is not one of 1, 5, 20"),
    ]:
        with pytest.raises(SystemExit) as left:
            main(command.split())
        told = capsys.readouterr()
        assert left.value.code == 2 and told.out == ""
        assert words in told.err and told.err.count("\n") == 1, told.err


@pytest.mark.parametrize("command", COMMANDS)
def test_help_says_one_default_of_a_flag_at_most_and_of_whole_flags(command, capsys):
    with pytest.raises(SystemExit):
        main([*command.split(), "--help"])
    shown = " ".join(line.strip("│ ") for line in capsys.readouterr().out.splitlines())
    assert "(default: )" not in shown and "STR [STR" not in shown
    for flag in re.split(r" (?=--[a-z])", shown):
        assert len(re.findall(r"\bdefault: |[Bb]y default", flag)) <= 1, flag


def asked(words: str):
    """What the command of these words would be asked for."""
    return next(iter(parse(words.split()).keywords.values()))


def test_what_videos_show_is_asked_for_by_flags():
    usual = asked("generate a.wav --out x")
    assert (usual.video.close_ups, usual.video.framing, usual.video.display) == (
        ("hands",),
        "knees",
        Display(),
    )
    assert usual.figures.start_frame == 0
    assert usual.output.has_video
    assert not asked("generate a.wav --out x --no-video").output.has_video
    drawn = asked(
        "render a.npz --out x.mp4 --close-up hands,face --framing knees "
        "--exaggerate 20 --trail --color jerk"
    )
    assert (drawn.video.close_ups, drawn.video.framing) == (("hands", "face"), "knees")
    assert drawn.video.display == Display(20, True, "jerk")
    assert asked("generate a.wav --out x --close-up off").video.close_ups == ()
    given = asked("diagnose a.npz b.npz --out x --videos --start 5 --panels a,d --show a,b")
    assert given.motions.motions == (Path("a.npz"), Path("b.npz")) and given.output.has_video
    assert (given.figures.start_frame, given.figures.figure_panels) == (5, ("a", "d"))
    assert given.motions.visible == ("a", "b")
    many = asked(
        "generate a.wav --systems all --steps x/a=2 --max-minutes 2 --channel left --out x"
    )
    assert (many.sampling.systems, many.sampling.steps) == ((), {"x/a": 2})
    assert (many.speech.max_speech_s, many.speech.channel) == (120, 0)


def test_generate_does_as_its_flags_say_tells_what_it_did_and_lists_its_files(
    eight_channels, weights, tmp_path, capsys
):
    out, words = tmp_path / "out", tmp_path / "speech.TextGrid"
    words.write_text(format_textgrid([NamedTier("words", (Interval(0.1, 0.4, "hello"),))], 2.0))
    flags = f"--systems globaldiff/global --tracked-point left_wrist --start 5 --transcript {words}"
    argv = generate(eight_channels, out, weights, *flags.split(), "--max-minutes", "0.04")
    assert main(argv) == 0
    said = capsys.readouterr()
    listed = [Path(line) for line in said.out.splitlines()]
    assert sorted(listed) == sorted(path for path in out.iterdir() if path.is_file())
    assert {path.name for path in listed} == {
        *("globaldiff-global.npz", "diagnostics.json", "diagnostics.csv", "provenance.json"),
        *("run.json", "speech.wav", "timeline.json"),
    }
    assert "8 channels" in said.err and "96,000 Hz" in said.err
    found = json.loads((out / "diagnostics.json").read_text())
    assert found["tracked_point"] == "left_wrist"
    assert found["words"] == [{"start_s": 0.1, "end_s": 0.4, "text": "hello", "confidence": 1.0}]
    assert found["words_origin"] == "given" and "phones" not in found
    provenance = json.loads((out / "provenance.json").read_text())
    assert provenance["options"]["transcript"] == "speech.TextGrid"
    assert provenance["speech"]["words"] == {"origin": "given", "count": 1}
    argv = generate(eight_channels, tmp_path / "no", weights, "--max-minutes", "0.03")
    assert "longer than the limit of 1.8 seconds" in sentence_after(argv, capsys)


def test_bad_files_give_the_sentence_of_their_reader_and_nothing_else(
    speech, weights, tmp_path, capsys
):
    bad, out = tmp_path / "bad.npz", tmp_path / "out"
    np.savez(bad, poses=np.array([{"a": 1}], dtype=object))
    bad_wav = tmp_path / "bad.wav"
    bad_wav.write_text("This is a shopping list: eggs, milk, bread.\n" * 50)
    for argv, words in (
        (generate(bad_wav, out, weights), "not a sound file"),
        (generate(speech, out, weights, "--reference", str(bad)), "pickled"),
        (generate(speech, out, weights, "--transcript", str(speech)), "speech.wav is not text"),
        (["diagnose", str(bad), "--out", str(out)], "pickled"),
        (["render", str(bad), "--out", str(tmp_path / "out.mp4")], "pickled"),
    ):
        assert words in sentence_after(argv, capsys)
    assert {path.name for path in tmp_path.iterdir()} == {"bad.npz", "bad.wav"}


def test_a_file_that_may_not_grow_gives_its_sentence(speech, weights, tmp_path, capsys):
    usual = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, usual[1]))
    try:
        said = sentence_after(generate(speech, tmp_path / "out", weights), capsys)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, usual)
    assert "is full; free some space" in said
    assert not (tmp_path / "out").exists()


class Terminal(io.StringIO):
    """Has the process terminated as soon as there is motion."""

    def __init__(self, out: Path) -> None:
        super().__init__()
        self.out = out

    def isatty(self) -> bool:
        return True

    def write(self, text: str) -> int:
        if list(self.out.glob(".unfinished*/*.npz")):
            self.out = self.out / "nowhere"  # once
            signal.raise_signal(signal.SIGTERM)
        return super().write(text)


def test_a_terminated_run_leaves_no_file(speech, weights, tmp_path, monkeypatch):
    terminal, before = Terminal(tmp_path / "out"), signal.getsignal(signal.SIGTERM)
    monkeypatch.setattr("sys.stderr", terminal)
    assert main(generate(speech, tmp_path / "out", weights)) == 1
    assert terminal.getvalue().endswith("Stopped. Nothing was saved.\n")
    assert not (tmp_path / "out").exists()
    assert signal.getsignal(signal.SIGTERM) == before


@pytest.fixture
def motion(tmp_path: Path) -> Path:
    path = tmp_path / "clip.npz"
    save_motion(smooth_motion_example(FRAMES), path)
    return path


def render(motion: Path, out: Path, *flags: str) -> list[Path]:
    """Files that the command lists, drawn small and fast."""
    argv = ["render", str(motion), "--out", str(out), "--size", "256", *flags]
    with contextlib.redirect_stdout(io.StringIO()) as listed:
        assert main(argv) == 0
    return [Path(line) for line in listed.getvalue().splitlines()]


@pytest.mark.gl
def test_stills_and_a_sheet_beside_a_video_and_for_each_view(motion, tmp_path):
    files = render(
        *(
            motion,
            tmp_path / "a.mp4",
            "--stills",
            "2",
            "--contact-sheet-every",
            "8",
            "--views",
            "front,side",
        )
    )
    assert [path.name for path in files] == [
        *("a.mp4", "a.1.png", "a.2.png", "a.sheet.png"),
        *("a.side.mp4", "a.side.1.png", "a.side.2.png", "a.side.sheet.png"),
    ]
    assert sorted(files) == sorted(p for p in tmp_path.iterdir() if p.name.startswith("a."))
    front, side = (np.asarray(Image.open(tmp_path / f"a{v}.1.png")) for v in ("", ".side"))
    assert front.shape == side.shape == (256, 256, 3) and (front != side).any()
    sheet = np.asarray(Image.open(tmp_path / "a.sheet.png")).astype(int)
    assert sheet.shape == (256 + label_band_height(256), 2 * 256, 3)
    for tile in np.hsplit(sheet, 2):
        assert tile[:256].std() > 5, "an empty picture"
        assert tile[256:].max() == 255 and tile[256:].min() < 120, "no time"


@pytest.mark.gl
def test_a_transparent_still_shows_the_body_of_the_look_and_nothing_else(motion, tmp_path):
    """A blue shirt, and the colour of clay; of one shape, and of another. A still, and the sheet of
    eight poses that is made by itself."""
    blue = {}
    for look, flags in (("average-light", ("--stills", "1")), ("average-clay", ())):
        out = tmp_path / f"{look}.png"
        assert render(motion, out, "--background", "transparent", "--look", look, *flags) == [out]
        sheet = np.asarray(Image.open(out)).astype(int)
        high = 256 + label_band_height(256)
        assert sheet.shape == ((256, 256, 4) if flags else (2 * high, 4 * 256, 4))
        picture = sheet[:256, :256]
        is_body = picture[..., 3] == 255
        assert 0.03 < is_body.mean() < 0.5 and (picture[:8, :, 3] == 0).all()
        blue[look] = np.mean(picture[is_body][:, 2] > picture[is_body][:, 0] + 20)
    assert blue["average-light"] > 0.2 and blue["average-clay"] == 0
    usual, broad = tmp_path / "usual.glb", tmp_path / "broad.glb"
    render(motion, usual)
    render(motion, broad, "--look", "broad-light")
    assert usual.read_bytes() != broad.read_bytes()


def test_what_the_blender_add_on_needs_is_there_without_pickles(motion, tmp_path, capsys):
    out = tmp_path / "clip.blender.npz"
    assert render(motion, out) == [out]
    original = smooth_motion_example(FRAMES)
    with np.load(out, allow_pickle=False) as data:
        # As the add-on reads them.
        assert str(data["gender"]) == "neutral" and str(data["surface_model_type"]) == "smplx"
        assert int(data["mocap_frame_rate"]) == 30
        np.testing.assert_array_equal(data["poses"], original.poses)
        np.testing.assert_array_equal(data["trans"], original.trans)
        assert data["betas"].shape == (10,) and data["poses"].shape == (FRAMES, 165)
        parts = ("root_orient", "pose_body", "pose_jaw", "pose_eye", "pose_hand")
        joined = np.concatenate([data[part] for part in parts], axis=1)
        np.testing.assert_array_equal(joined, original.poses)
        assert data["expressions"].shape == (FRAMES, 100) and not data["expressions"].any()
    capsys.readouterr()
    faces = np.random.default_rng(0).normal(size=(FRAMES, 100)).astype(np.float32)
    flame = replace(original, expressions=faces, expression_basis="flame100")
    save_motion(flame, tmp_path / "flame.npz")
    render(tmp_path / "flame.npz", out)
    with np.load(out, allow_pickle=False) as data:  # BEAT2's version reads the face, too
        np.testing.assert_array_equal(data["expressions"], faces)
    assert "expressions are left out" not in capsys.readouterr().err


def test_render_says_what_it_cannot_do(motion, capsys):
    for flags, words in [
        ("/nowhere/a.mp4", "folder /nowhere does not exist"),
        ("a.gif", "must end in one of .mp4, .png, .glb, .vrma, .bvh, .blender.npz"),
        (".mp4", "must end in one of"),
        ("a.png --stills 0", "1 to 64; got 0"),
        ("a.png --stills 65", "1 to 64; got 65"),
        ("a.png --contact-sheet-every 0", "got 0"),
        ("a.glb --stills 2", "cannot be used with a .glb file"),
        ("a.bvh --contact-sheet-every 2", "cannot be used with a .bvh file"),
        ("a.glb --exaggerate 5", "stores the unchanged motion"),
        ("a.mp4 --background transparent", "A .mp4 file cannot have"),
        ("a.png --background transparent --trail", "not possible with a transparent background"),
        ("a.png --background transparent --close-up face", "Close-ups are not possible with a"),
        ("a.mp4 --speech /nowhere.wav", "no speech file at /nowhere.wav"),
        ("a.mp4 --frame 3 --plan a.json", "made from one chosen frame; remove --frame."),
        ("a.glb --views side", "no sound, camera or tracked point; remove --views."),
        ("a.mp4 --body /nowhere.npz", "nowhere.npz"),
    ]:
        assert words in sentence_after(["render", str(motion), "--out", *flags.split()], capsys)


@pytest.mark.gl
def test_a_video_without_an_encoder_and_a_sheet_too_large_give_their_sentence(
    motion, tmp_path, monkeypatch, capsys
):
    save_motion(smooth_motion_example(130), motion)
    argv = ["render", str(motion), "--size", "256", "--out"]
    told = sentence_after([*argv, str(tmp_path / "a.png"), "--contact-sheet-every", "2"], capsys)
    assert "--contact-sheet-every 3 or more" in told
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", "/nowhere/ffmpeg")
    told = sentence_after([*argv, str(tmp_path / "a.mp4")], capsys)
    assert "/nowhere/ffmpeg is not an ffmpeg" in told
    assert [path.name for path in tmp_path.iterdir()] == [motion.name]


def test_a_backend_that_cannot_be_imported_is_told_and_does_no_harm(tmp_path):
    """As Colab and Jupyter leave it to programs that are not of their own Python."""
    backend = "module://matplotlib_inline.backend_inline"
    draw = (
        "from app.commands.cli import main\n"
        "import sys\n"
        "main(['doctor', '--weights', sys.argv[1]])\n"
        "from matplotlib import pyplot\n"
        "pyplot.figure().savefig(sys.argv[1] + '/a.png')\n"
    )
    ended = subprocess.run(
        [sys.executable, "-c", draw, str(tmp_path)],
        cwd=ROOT,
        env={**os.environ, "MPLBACKEND": backend},
        check=False,
        capture_output=True,
        text=True,
    )
    assert ended.returncode == 0 and (tmp_path / "a.png").is_file(), ended.stderr
    assert re.search(f"--  MPLBACKEND +{backend} cannot be imported: ", ended.stdout)


def test_flags_that_a_command_would_ignore_are_refused(motion, tmp_path, capsys):
    folder, out = tmp_path / "sets", str(tmp_path / "out")
    folder.mkdir()
    for argv, words in [
        (
            ["diagnose", str(folder), "--tracked-point", "neck", "--window", "60"],
            "remove --tracked-point and --win",
        ),
        (["diagnose", str(folder), "--figures", "png"], "remove --figures"),
        (["diagnose", str(folder), "--check", "genea", "--channel", "left"], "remove --channel"),
        (
            ["speech-effect", str(folder), "--guidance", "2", "--seeds", "3"],
            "remove --guidance and --seeds",
        ),
        (["convert", str(motion), "--out", "a.bvh", "--to", ".glb"], "remove --to"),
    ]:
        argv = argv if "--out" in argv else [*argv, "--out", out]
        said = sentence_after(argv, capsys)
        named = said.replace("--window and --tracked-point", "--tracked-point and --window")
        assert words in named.replace("--seeds and --guidance", "--guidance and --seeds"), said
    assert not Path(out).exists()


def test_doctor_finds_what_is_missing(weights, tmp_path, capsys):
    status = main(["doctor", "--weights", str(tmp_path)])
    out, told = capsys.readouterr()
    assert status == 1
    assert "NO  weights" in out and "--weights DIR" in out and "weights" in told
    assert re.search(r"ok +OpenGL \w+ +pyrender renders with .* \(selected\)$", out, re.MULTILINE)
    assert len(re.findall(r" \(selected\)$", out, re.MULTILINE)) == 1
    assert doctor._weights(weights).works and not doctor._weights(tmp_path).works


def test_former_names_of_commands_and_flags_are_accepted_with_a_message(tmp_path, capsys):
    def parsed(line: str) -> tuple[tuple[Any, ...], str]:
        command: Any = parse([*line.split(), "--out", str(tmp_path / "a.mp4")])
        return (command.func, *command.args, command.keywords), capsys.readouterr().err

    for former, current, told in [
        ("mechanism a.npz", "rotation-noise a.npz", "mechanism was renamed to rotation-noise"),
        ("render a.npz --joint=neck", "render a.npz --tracked-point neck", "--tracked-point"),
        (
            "render a.npz --sheet 3",
            "render a.npz --contact-sheet-every 3",
            "--sheet was renamed",
        ),
        ("diagnose a.npz --no-pictures", "diagnose a.npz --no-poses", "to --no-poses"),
    ]:
        (old, said), (new, silence) = parsed(former), parsed(current)
        assert old == new and told in said and not silence
