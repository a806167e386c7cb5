"""The program from Python: files and arrays in, motion, numbers and players out."""

import ast
import json
import re
from typing import Any

import numpy as np
import pytest

from app import notebook
from app.errors import RunError
from app.findings.metric_table import JERK
from app.notebook import compare, diagnose, generate, motions_by_name, read_motion, read_speech
from model.motion.motion import save_motion
from model.speech.audio import SpeechError
from tests.helpers import ROOT, smooth_motion_example
from tests.model.made import made_waveform


@pytest.mark.parametrize("rate", [16_000, 48_000])
@pytest.mark.parametrize("form", ["float", "int16", "stereo"])
def test_samples_are_heard_as_a_file_of_them_is(rate, form):
    wave = 0.5 * np.sin(2 * np.pi * 220 * np.arange(rate) / rate)
    samples = {
        "float": wave,
        "int16": (32767 * wave).astype(np.int16),
        "stereo": np.stack([wave, wave], axis=1),
    }[form]
    heard = read_speech((samples, rate)).waveform
    assert len(heard) == 16_000
    expected = 0.5 * np.sin(2 * np.pi * 220 * np.arange(16_000) / 16_000)
    assert np.abs(heard - expected)[200:-200].max() < 2e-3


def test_what_is_no_sound_is_refused():
    with pytest.raises(RunError, match=r"\(N,\) or \(N, channels\)"):
        read_speech((np.zeros((2, 3, 4)), 16_000))
    with pytest.raises(SpeechError, match="does not exist"):
        read_speech("nothing.wav")


def test_fields_that_no_run_has_are_refused():
    sound = (np.zeros(16_000, np.float32), 16_000)
    for asked, words in (
        ({"sped": 1}, "no option 'sped'; choose from body,"),
        ({"recognise_words": 1}, "use word_source="),
    ):
        with pytest.raises(RunError, match=words):
            generate(sound, progress=False, **asked)


def test_motions_have_their_files_names(tmp_path):
    motion = smooth_motion_example(40)
    save_motion(motion, tmp_path / "mine.npz")
    assert list(motions_by_name(tmp_path / "mine.npz")) == ["mine"]
    assert list(motions_by_name(motion)) == ["motion"]
    assert read_motion(motion) is motion
    with pytest.raises(RunError, match="at least one"):
        motions_by_name({})


def test_the_table_marks_the_nearest_and_leaves_out_what_nobody_has():
    calm, recorded = smooth_motion_example(60), smooth_motion_example(60, seed=1)
    shaken = calm.part(np.arange(60)[::2].repeat(2))  # each frame twice: steps
    found = compare({"calm": calm, "shaken": shaken, "reference": recorded})
    assert list(found.table.columns) == ["calm", "shaken", "reference"]
    calm_jerk, shaken_jerk, _ = found.table.loc[JERK]
    assert list(found.nearest_to_reference[JERK]) == ["calm"] and shaken_jerk > 3 * calm_jerk
    assert not any("beat_align" in key for key in found.table.index)
    assert set(found.rotation_difference_deg) == {
        ("calm", "shaken"),
        ("calm", "reference"),
        ("shaken", "reference"),
    }
    shown = found._repr_html_()
    assert f"<b>{calm_jerk:.3g}</b>" in shown and "n/a" in shown and "nan" not in shown
    assert (
        found.protocol_id_by_metric["l1_diversity_m"] == "l1div/emage"
        and "Protocol workbench/1." in shown
    )


def test_speech_becomes_motion_numbers_and_a_player_as_a_run_makes_them(weights):
    speech = (made_waveform(16_000 * 40 // 30), 16_000)
    names = ["globaldiff/local", "globaldiff/global"]
    asked = {"speaker": "ann", "seed": 1, "steps": 1, "weights": weights, "progress": False}
    done = generate(speech, names, **asked)
    assert list(done.motions) == names and not done.plans
    assert all(motion.num_frames == 40 for motion in done.motions.values())
    alone = generate(speech, names[1], **asked)[names[1]]
    np.testing.assert_array_equal(alone.poses, done[names[1]].poses)
    found = diagnose(done.motions, speech=speech, progress=False)
    for name in names:
        jerks = [each.systems[name].raw.point.tip_jerk_m_s3 for each in (found, done.diagnostics)]
        assert jerks[0] == jerks[1] > 0
    assert list(done.compare().table.columns) == names
    html = done.show().html
    assert all(f'"{name}"' in html for name in names) and "jerk (m/s³)" in html


CELLS = json.loads((ROOT / "docs" / "notebook.ipynb").read_text("utf-8"))["cells"]
NUMBER = re.compile(r"-?\d+(\.\d+)?(e[+-]?\d+)?")


def ran(source: str, names: dict[str, Any]) -> Any:
    """The value of the cell's last line, as Jupyter shows it."""
    tree = ast.parse(source)
    last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, "cell", "exec"), names)
    return (
        None if last is None else eval(compile(ast.Expression(last.value), "cell", "eval"), names)
    )


def words(text: str) -> str:
    """What does not depend on the processor."""
    return "".join(NUMBER.sub("#", text).split())


def test_all_that_it_imports_is_there():
    code = "\n".join("".join(cell["source"]) for cell in CELLS if cell["cell_type"] == "code")
    imports = [node for node in ast.parse(code).body if isinstance(node, ast.ImportFrom)]
    assert len(imports) > 3
    exec(compile(ast.Module(imports, []), "imports", "exec"), {})


@pytest.mark.slow
def test_it_runs_from_top_to_bottom(monkeypatch):
    monkeypatch.chdir(ROOT)
    names: dict[str, Any] = {}
    shown = 0
    for cell in CELLS:
        if cell["cell_type"] != "code":
            continue
        value = ran("".join(cell["source"]), names)
        told = [output["data"] for output in cell["outputs"]]
        assert len(told) == 1, "every cell of the notebook shows something, and was executed"
        if "text/html" in told[0]:
            html = "".join(told[0]["text/html"])
            assert words(value._repr_html_())[:400] == words(html)[:400]
        elif "image/png" not in told[0]:
            shown += 1
            assert words("".join(told[0]["text/plain"])) == words(repr(value))
    assert shown > 5
    both = names["both"]
    assert list(both) == ["globaldiff/local", "globaldiff/global", "workbench/planned"]
    assert all(motion.num_frames == 180 for motion in both.values())


def test_former_names_are_accepted_with_a_sentence():
    with pytest.warns(
        FutureWarning, match="find_plan is deprecated and will be removed; use detect_plan"
    ):
        assert notebook.find_plan is notebook.detect_plan
    with pytest.raises(AttributeError):
        notebook.nothing  # noqa: B018
