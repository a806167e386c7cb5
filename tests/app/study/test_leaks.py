"""Leaks are planted in copies of a sound study, and each is found by name."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from app.commands.cli import main
from app.errors import RunError
from app.study.design.key import read_key
from app.study.leaks import check_study
from app.study.make import media
from app.study.make.media import set_time
from app.study.make.mp4 import frames_of, joined
from app.study.make.participant_page import DATA, INDEX
from app.study.make.workspace import Workspace
from tests.app.study.made_study import (
    CLIPS,
    SIZE,
    SYSTEMS,
    accept_video,
    change_data,
    copy_study,
    ffmpeg,
    rename_videos,
    video_of,
)

COPY = ("-c", "copy", "-fflags", "+bitexact")
SINE = ("-f", "lavfi", "-i", "sine=duration=0.5")
Plant = Callable[[Workspace], None]


def changed(clip: str, *arguments: str, system: str = "localnet") -> Plant:
    """Puts one video through ffmpeg, and lets the key take the result for right."""

    def change(study: Workspace) -> None:
        video, out = video_of(study, system, clip), study.private / "changed.mp4"
        ffmpeg("-i", str(video), *arguments, "-movflags", "+faststart", str(out))
        shutil.move(out, video)
        accept_video(study, video)

    return change


def pad(study: Workspace, system: str, clip: str, num_bytes: int) -> None:
    video = video_of(study, system, clip)
    with video.open("ab") as file:
        file.write(num_bytes.to_bytes(4, "big") + b"free" + bytes(num_bytes - 8))
    accept_video(study, video)


def _names_in_order(study: Workspace) -> None:
    """Random digits behind a first one that follows the system."""
    key = read_key(study.key)
    place = {name: str(i) for i, name in enumerate(SYSTEMS)}
    rename_videos(study, {b: place[v.system] + b[1:] for b, v in key.videos.items()})


def _system_in_json(study: Workspace) -> None:
    change_data(study, lambda data: next(iter(data["trials"].values())).update(system="globalnet"))


def _order_of_trials(study: Workspace) -> None:
    change_data(
        study, lambda data: data.update(trials=dict(sorted(data["trials"].items(), reverse=True)))
    )


def _title(study: Workspace) -> None:
    change_data(study, lambda data: data.update(title="Globalnet against the rest"))
    index = study.bundle / INDEX
    index.write_text(index.read_text().replace("Which moves better?", "Globalnet against the rest"))
    set_time(index)


def _always_left(study: Workspace) -> None:
    key = read_key(study.key)

    def change(data: dict) -> None:
        for page in (page for pages in data["lists"] for page in pages):
            page[1].sort(key=lambda blind: SYSTEMS.index(key.videos[blind].system))

    change_data(study, change)


def _script(study: Workspace) -> None:
    path = study.bundle / "study.js"
    path.write_text(path.read_text() + "// globalnet first\n")
    set_time(path)


def _key_in_bundle(study: Workspace) -> None:
    shutil.copy(study.key, study.bundle / "key.json")
    set_time(study.bundle / "key.json")
    set_time(study.bundle)


def _slightly_larger_files(study: Workspace) -> None:
    """Within two percent, and always in the same order."""
    for clip in CLIPS:
        for number, system in enumerate(SYSTEMS):
            pad(study, system, clip, 8 + 20 * number)


def _large_file(study: Workspace) -> None:
    size = video_of(study, "localnet", "garden").stat().st_size
    pad(study, "localnet", "garden", round(0.03 * size))


def _bit_rate(study: Workspace) -> None:
    """A picture of fewer bytes in a file of the old size."""
    video = video_of(study, "localnet", "kitchen")
    size = video.stat().st_size
    changed("kitchen", "-c:v", "libx264", "-crf", "45", "-bf", "0")(study)
    pad(study, "localnet", "kitchen", size - video.stat().st_size)


def put_stream(study: Workspace, clip: str, frames: list[list[bytes]]) -> None:
    """In the place of the picture of one video, in a file of the old size."""
    video, stream = video_of(study, "localnet", clip), study.private / "changed.h264"
    size = video.stat().st_size
    stream.write_bytes(joined(frames))
    media.join(stream, None, video)
    missing = size - video.stat().st_size
    if missing < 8:
        accept_video(study, video)
    else:
        pad(study, "localnet", clip, missing)


def _packets(study: Workspace) -> None:
    """As many bytes in all, filled up at the end alone."""
    frames = frames_of(media.picture_stream(video_of(study, "localnet", "street")))
    own = [[unit for unit in units if unit[0] & 31 != 6] for units in frames]
    own[-1][:0] = [unit for units in frames for unit in units if unit[0] & 31 == 6]
    put_stream(study, "street", own)


def _filling(study: Workspace) -> None:
    """Packets as large as the others', of a picture that needed less."""
    video, out = video_of(study, "localnet", "office"), study.private / "changed.h264"
    sizes = [
        sum(4 + len(unit) for unit in units) for units in frames_of(media.picture_stream(video))
    ]
    media.encode_picture(video, out, SIZE, 0.5)
    frames = frames_of(out.read_bytes())
    for units, size in zip(frames, sizes, strict=True):
        missing = size - sum(4 + len(unit) for unit in units)
        if missing > 6:
            units.insert(-1, b"\x0c" + b"\xff" * (missing - 6) + b"\x80")
    put_stream(study, "office", frames)


def _loud_sound(study: Workspace) -> None:
    for video in sorted(study.media.iterdir()):
        out = study.private / "changed.mp4"
        ffmpeg("-i", str(video), "-c:v", "copy", "-af", "volume=-9dB", "-c:a", "aac", str(out))
        shutil.move(out, video)
        accept_video(study, video)


PLANTED: dict[str, tuple[list[Plant], list[str]]] = {
    "files": (
        [
            _key_in_bundle,
            lambda study: video_of(study, "localnet", "garden").unlink(),
            lambda study: video_of(study, "localnet", "street").write_bytes(b"other") and None,
        ],
        ["stray file: key.json", "missing file: media/", "changed file: media/"],
    ),
    "what the page consists of": (
        [
            _always_left,
            _system_in_json,
            _order_of_trials,
            lambda study: change_data(study, lambda data: data.update(conditions=[1, 2, 3])),
            lambda study: change_data(
                study, lambda data: data["lists"][0][0].append("https://host/a.mp4")
            ),
            lambda study: change_data(
                study, lambda data: data["lists"][0].append(["x", ["media/RECORDED/x.mp4"]])
            ),
            _title,
            _script,
        ],
        [
            "order on the screen: 'localnet' stands first",
            "JSON: the page's data hold 'globalnet'",
            "JSON: the trials do not stand in the order",
            "JSON: the field `conditions` is unknown",
            "URL: the page's data hold an address",
            "JSON: the page's data hold 'recorded'",
            "text: `title` holds 'globalnet'",
            "page: study.js is not the file of this program",
        ],
    ),
    "names in the systems' order": (
        [_names_in_order],
        ["file name: its order follows the system"],
    ),
    "metadata": (
        [
            changed("kitchen", *COPY, "-metadata", "title=localnet"),
            changed("garden", "-c", "copy", "-metadata", "creation_time=2026-01-01T00:00:00"),
            changed("street", *COPY, "-metadata:s:v:0", "handler_name=run 17"),
            changed("office", "-c:v", "libx264", "-b:v", "100k"),
            lambda study: video_of(study, "globalnet", "garden").touch(),
            lambda study: rename_videos(
                study, {video_of(study, "recorded", "garden").stem: "localnet-1"}
            ),
        ],
        [
            "{localnet-kitchen} has a `udta` box",
            "{localnet-kitchen} holds the name 'localnet'",
            "{localnet-garden} holds the time at which it was made",
            "{localnet-street} names its streams run 17",
            "{localnet-office} holds an encoder's note",
            "time stamp: {globalnet-garden}",
            "file name: media/localnet-1.mp4",
        ],
    ),
    "sizes": (
        [_large_file, _bit_rate, _packets, _filling],
        [
            "size: the videos of clip 'garden' differ by",
            "bit rate: the videos of clip 'kitchen' differ by",
            "packet sizes: the videos of clip 'street' differ",
            "filling: the videos of clip 'office' differ by",
            "compressed size: the videos of clip 'office'",
        ],
    ),
    "slightly larger files": ([_slightly_larger_files], ["size: its order follows the system"]),
    "length and sound": (
        [
            changed("garden", *COPY, "-frames:v", "14"),
            changed("street", *SINE, "-map", "0:v", "-map", "1:a", "-c:v", "copy"),
        ],
        [
            "frames: the videos of clip 'garden' differ",
            "{localnet-street} has sound, unlike the others",
        ],
    ),
}
PLANTED_SOUND: dict[str, tuple[list[Plant], list[str]]] = {
    "another encoding of the sound, and none": (
        [
            changed("garden", "-c:v", "copy", "-c:a", "aac", "-b:a", "64k"),
            changed("garden", "-c:v", "copy", "-an", system="globalnet"),
        ],
        ["is not the same stream in every video", "has no sound, unlike the others"],
    ),
    "another loudness": ([_loud_sound], ["LUFS in place of -23"]),
}


def test_a_sound_study_has_no_leak(silent_study: Path, spoken_study: Path) -> None:
    assert check_study(silent_study) == []
    assert check_study(spoken_study) == []


@pytest.mark.parametrize("leaks", [*PLANTED, *PLANTED_SOUND])
def test_planted_leaks_are_found(
    silent_study: Path, spoken_study: Path, tmp_path: Path, leaks: str
) -> None:
    plants, sentences = (PLANTED | PLANTED_SOUND)[leaks]
    study = copy_study(silent_study if leaks in PLANTED else spoken_study, tmp_path / "study")
    names = {
        f"{{{system}-{clip}}}": f"media/{video_of(study, system, clip).name}"
        for system in SYSTEMS[: 3 if leaks in PLANTED else 2]
        for clip in CLIPS[: 4 if leaks in PLANTED else 2]
    }
    for plant in plants:
        plant(study)
    found = check_study(tmp_path / "study")
    for sentence in sentences:
        for placeholder, name in names.items():
            sentence = sentence.replace(placeholder, name)
        assert any(sentence in each for each in found), (sentence, found)


def test_the_command_fails_loudly_and_names_the_leak(
    silent_study: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["study", "check", str(silent_study)]) == 0
    assert capsys.readouterr().out == "No leak was found.\n"
    study = copy_study(silent_study, tmp_path / "study")
    video_of(study, "localnet", "garden").touch()
    assert main(["study", "check", str(tmp_path / "study")]) == 1
    said = capsys.readouterr()
    assert said.out == "" and said.err.startswith("LEAK time stamp: media/")
    assert said.err.endswith("1 leak was found; do not host this bundle.\n")


def test_a_damaged_unfinished_or_missing_study_gives_a_sentence(
    silent_study: Path, tmp_path: Path
) -> None:
    with pytest.raises(RunError, match="There is no study in"):
        check_study(tmp_path)
    study = copy_study(silent_study, tmp_path / "study")
    (study.bundle / DATA).write_text("window.STUDY = {")
    set_time(study.bundle / DATA)
    with pytest.raises(RunError, match="is not what the export wrote"):
        check_study(tmp_path / "study")
    digest = next(iter(read_key(study.key).videos.values())).sha256
    study.key.write_text(study.key.read_text().replace(digest, "not made yet"))
    with pytest.raises(RunError, match="is not finished; run it again"):
        check_study(tmp_path / "study")
