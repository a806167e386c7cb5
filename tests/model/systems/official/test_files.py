"""The authors' files are told by their names."""

from pathlib import Path

import pytest

from model.storage.cards import CheckpointError
from model.systems.official.files import official_files, part_of, require_official

MOTION = (
    "ckpt/split/DiffusionDITNetPartsFixedExpressions2PostNorm_LL_split_HorizonFlip_MaskedVAE3_W02"
)


def _made(folder: Path, *names: str) -> Path:
    for name in names:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    return folder


@pytest.mark.parametrize(
    ("name", "part"),
    [
        (f"{MOTION}/epoch_999", "motion"),
        (f"{MOTION}/best.pt", "motion"),
        ("epoch_19", "motion"),
        ("SimpleSpeechModel/best.pt", "expression"),
        ("SimpleSpeechModel/best.zip", "expression"),
        ("VAE/ckpt/split/global/MaskedVAE2-HorizonFlip/best.pt", "vae2"),
        ("VAE/ckpt/split/global/MaskedVAE3-HorizonFlip/best.pt", "vae3"),
        ("best.pt", None),
        (f"{MOTION}/log.txt", None),
        (f"{MOTION}/epoch_999_results", None),
    ],
)
def test_names_tell_the_network(name, part):
    assert part_of(Path(name)) == part


def test_the_last_epoch_is_taken_unless_one_is_called_best(tmp_path):
    folder = _made(tmp_path, *(f"{MOTION}/epoch_{n}" for n in (19, 999, 99)), "speech/best.pt")
    files = require_official(folder)
    assert files.path("motion").name == "epoch_999" and "expression" in files.found
    _made(folder, f"{MOTION}/best.pt")
    assert require_official(folder).path("motion").name == "best.pt"


def test_the_folders_own_name_counts(tmp_path):
    files = official_files(_made(tmp_path / "SimpleSpeechModel", "best.pt"))
    assert files is not None and list(files.found) == ["expression"]


def test_what_is_missing_is_told(tmp_path, monkeypatch):
    monkeypatch.delenv("OFFICIAL_DIR", raising=False)
    assert official_files() is None
    with pytest.raises(CheckpointError, match="name their folder with --official FOLDER"):
        require_official()
    with pytest.raises(CheckpointError, match=r"There is no folder .*nowhere; name the one"):
        official_files(tmp_path / "nowhere")
    with pytest.raises(CheckpointError, match="no file of the motion network; put it there as"):
        require_official(tmp_path)
    monkeypatch.setenv("OFFICIAL_DIR", str(_made(tmp_path, "epoch_19")))
    with pytest.raises(CheckpointError, match=r"no file of the expression model; .* Simple"):
        require_official()
