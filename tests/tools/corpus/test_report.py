"""A page from a corpus: which clips it tells of, and what it says of them."""

import re
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from tools.corpus.people.rig import open_body_rig
from tools.corpus.report import __main__ as report
from tools.corpus.report.__main__ import ReportError, list_clips, measure_clips, report_page


def copies_of(corpus: Path, root: Path, names: list[str]) -> Path:
    """A data folder whose clips are all the one of the corpus."""
    for folder, suffix in (("smplxflame_30", "npz"), ("textgrid", "TextGrid")):
        (root / folder).mkdir(parents=True)
        for name in names:
            shutil.copy(next((corpus / folder).iterdir()), root / folder / f"{name}.{suffix}")
    (root / "train_test_split.csv").write_text(
        "id,type\n" + "".join(f"{name},test\n" for name in names)
    )
    return root


@pytest.mark.slow
def test_the_page_names_every_speaker_and_shows_pictures(corpus, tmp_path, capsys):
    assert report.main(["--data", str(tmp_path), "--out", str(tmp_path / "page.md")]) == 1
    assert "holds no clips in BEAT2's layout" in capsys.readouterr().err
    assert not (tmp_path / "page.md").exists()
    out = tmp_path / "docs" / "corpus.md"
    out.parent.mkdir()
    assert report.main(["--data", str(corpus), "--real", str(corpus), "--out", str(out)]) == 0
    page = out.read_text()
    assert "2 clips of seed 3 by 2 speakers" in page
    assert "| figure | 1_anna_0_0_0 | 2_ben_0_1_1 | corpus |" in page
    assert "There are too few clips for a classifier." not in page
    assert "(figures/corpus_gestures.png)" in page
    picture = out.parent / "figures" / "corpus_gestures.png"
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_clips_without_motion_are_left_out(corpus, tmp_path):
    root = copies_of(corpus, tmp_path / "real", ["1_a_0_1_1", "1_a_0_2_2"])
    (root / "smplxflame_30" / "1_a_0_1_1.npz").unlink()
    assert list(list_clips(root)) == ["1_a_0_2_2"]
    (root / "smplxflame_30" / "1_a_0_2_2.npz").unlink()
    with pytest.raises(ReportError, match="holds no clips in BEAT2's layout"):
        list_clips(root)


def test_the_page_says_what_gives_the_corpus_away(corpus, tmp_path):
    """Copies of one clip as real and as corpus cannot be told apart; a changed figure can."""
    root = copies_of(corpus, tmp_path / "real", [f"1_a_0_{k}_{k}" for k in range(4)])
    clips = measure_clips(list_clips(root), open_body_rig(), "Measuring")
    assert "is reached." in report_page(clips[:2], clips[2:], None)
    shaky = [
        replace(
            clip,
            realism=clip.realism.assign(
                **{"wrist jerk, m/s^3": clip.realism["wrist jerk, m/s^3"] + 500.0}
            ),
        )
        for clip in clips[:2]
    ]
    page = report_page(shaky, clips[2:], None)
    assert "area under the curve of **1.00**" in page
    assert "is missed." in page
    assert re.search(r"\| wrist jerk, m/s\^3 \|.*\| 1.00 \| 0.50 \| 100% \|", page)
