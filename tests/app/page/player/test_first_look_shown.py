"""The example before the first run: kept apart for each state of what it is made of, and told."""

import shutil
from pathlib import Path

import pytest

from app import text
from app.config import EXAMPLES, AppConfig
from app.page.parts.catalogue import Catalogue, Example
from app.page.player.first_look_shown import EXAMPLE, FirstLooks, question
from app.page.queue.jobs import JobBook
from app.page.routes.media import MediaAddresses
from app.run.examples import CLEAN, FACTS, STEADY, TREMBLING, FirstLook, first_look
from model.motion.motion import load_motion, save_motion
from model.systems.globaldiff.config import BEST

SPEECH = EXAMPLES / f"{EXAMPLE}.wav"
CARD = f"{BEST.replace('/', '-')}.json"


def test_other_weights_or_speech_are_another_example(tmp_path: Path) -> None:
    speech, card = tmp_path / "s.wav", tmp_path / CARD
    speech.write_bytes(b"1")
    card.write_text("{}")
    folder = first_look(tmp_path, tmp_path, BEST, speech).folder
    assert first_look(tmp_path, tmp_path, BEST, speech).folder == folder
    assert tmp_path in folder.parents
    card.write_text('{"steps": 2}')
    other = first_look(tmp_path, tmp_path, BEST, speech).folder
    speech.write_bytes(b"2")
    assert len({folder, other, first_look(tmp_path, tmp_path, BEST, speech).folder}) == 3


@pytest.fixture
def media() -> MediaAddresses:
    return MediaAddresses()


@pytest.fixture
def config(tmp_path: Path) -> AppConfig:
    weights = tmp_path / "weights"
    weights.mkdir()
    (weights / CARD).write_text("{}")
    return AppConfig(weights=weights, kept=tmp_path / "kept")


@pytest.fixture
def looks(config: AppConfig, media: MediaAddresses, tmp_path: Path) -> FirstLooks:
    """Whose example cannot be made, and may be there already."""

    def fail(look: FirstLook, weights: Path) -> None:
        raise AssertionError("it was there, or cannot be made")

    catalogue = Catalogue((BEST,), ("ann",), "", (Example("Three reasons", SPEECH),))
    return FirstLooks(config, catalogue, JobBook(tmp_path / "jobs"), media, fail)


def test_what_has_been_made_is_shown_to_every_visitor_without_a_cookie(
    looks: FirstLooks, config: AppConfig, media: MediaAddresses
) -> None:
    look = first_look(config.kept, config.weights, BEST, SPEECH)
    look.folder.mkdir(parents=True)
    shutil.copyfile(SPEECH, look.beginning)
    clean = load_motion(CLEAN).part(slice(40))
    for name in (STEADY, TREMBLING):
        save_motion(clean, look.folder / f"{name}.npz")
    (look.folder / FACTS).write_text(
        '{"jerk_m_s3": {"A": 110, "B": 2300}, "noise_rad": 0.012, "provenance": {}}'
    )
    assert not isinstance(looks.updates()[0].get("rows"), list)
    assert looks.is_coming and text.LOOK_COMING in looks.updates()[1]
    looks.make()
    assert not looks.is_coming and looks.version == 2
    value, told = looks.updates()
    assert value["plays"] and [row["name"] for row in value["rows"]] == [STEADY, TREMBLING]
    for row in value["rows"]:
        assert media.find(row["frames"].rsplit("/", 1)[-1], "of anybody") is not None
        assert not row["is_drawn"] and "video" not in row
    assert media.find(value["timeline"].rsplit("/", 1)[-1], "") is not None
    assert "Which hand trembles?" in told


def test_an_example_that_cannot_be_made_is_awaited_no_longer(looks: FirstLooks) -> None:
    assert looks.is_coming
    looks.make()
    assert not looks.is_coming and not isinstance(looks.updates()[1], str)


def test_the_answer_is_folded_away_and_has_the_numbers() -> None:
    told = question({"jerk_m_s3": {STEADY: 110, TREMBLING: 2300}, "noise_rad": 0.012}, "a<b")
    before, after = told.split("<summary>")
    assert TREMBLING not in before.split("<p>")[0] and "2,300" not in before
    assert "2,300" in after and "110" in after and "a&lt;b" in before
