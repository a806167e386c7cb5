"""The player in one file."""

import json
import re

import pytest

from app.errors import RunError
from app.notebook import show
from app.page.alone import DOOR, WEB, Scene, _needed, player_alone
from model.speech.audio import Speech
from tests.helpers import smooth_motion_example
from tests.model.made import made_waveform


def test_every_import_of_the_modules_is_of_the_form_that_is_read() -> None:
    """Else a module would ask for a file that is not there."""
    for path in _needed(DOOR):
        source = re.sub(r"/\*.*?\*/", "", (WEB / path).read_text(), flags=re.DOTALL)
        imports = re.findall(r"^import\b.*?;", source, re.MULTILINE | re.DOTALL)
        assert all(re.search(r'from "\.{1,2}/[^"]+";$', line) for line in imports), path
        other = r'\bimport\(|^export [{*].* from|^import "'
        assert not re.search(other, source, re.MULTILINE), path


def test_no_name_or_word_ends_the_page_and_what_cannot_be_played_is_refused() -> None:
    name = "</script><script>alert(1)</script>"
    scene = Scene({name: smooth_motion_example(40)}, {"words": [[0, 1, name]]}, title="</title><b>")
    html = player_alone(scene)
    assert "alert(1)</script>" not in html and "</title><b>" not in html
    told = html.split('id="kept">')[1].split("</script>")[0]
    assert json.loads(told)["value"]["rows"][0]["name"] == name
    with pytest.raises(RunError, match="no motion"):
        player_alone(Scene({}, {}))


def test_the_same_scene_gives_the_same_file() -> None:
    speech, motions = Speech(made_waveform(32_000), ""), {"one": smooth_motion_example(60)}
    assert show(motions, speech).html == show(motions, speech).html
