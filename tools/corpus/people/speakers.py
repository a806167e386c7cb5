"""The speakers, as ``speakers.toml`` beside this tells them."""

import tomllib
from pathlib import Path

from model.storage.cards import from_dict
from tools.corpus.people.speaker import Speaker

_FILE = Path(__file__).with_name("speakers.toml")

SPEAKERS: tuple[Speaker, ...] = tuple(
    from_dict(Speaker, told) for told in tomllib.loads(_FILE.read_text("utf-8"))["speakers"]
)
