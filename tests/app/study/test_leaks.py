"""Leaks are planted in copies of a sound study, and each is found by name."""

import shutil
from collections.abc import Callable

import pytest

from app.commands.cli import main
from app.errors import RunError
from app.study.design.key import read_key
from app.study.leaks import find_leaks
from app.study.make import media
from app.study.make.bundle import DATA, INDEX
from app.study.make.export_folders import ExportFolders
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
Plant = Callable[[ExportFolders], object]


def changed(clip: str, *arguments: str) -> Plant:
    """Puts one video through ffmpeg, and lets the key take the result for right."""

    def change(study: ExportFolders) -> None:
        video, out = video_of(study, "localnet", clip), study.private / "changed.mp4"
        ffmpeg("-i", str(video), *arguments, "-movflags", "+faststart", str(out))
        shutil.move(out, video)
        accept_video(study, video)

    return change


def pad(study: ExportFolders, system: str, clip: str, num_bytes: int) -> None:
    video = video_of(study, system, clip)
    with video.open("ab") as file:
        file.write(num_bytes.to_bytes(4, "big") + b"free" + bytes(num_bytes - 8))
    accept_video(study, video)


def _names_in_order(study: ExportFolders) -> None:
    """Random digits behind a first one that follows the system."""
    key = read_key(study.key)
    place = {name: str(i) for i, name in enumerate(SYSTEMS)}
    rename_videos(study, {b: place[v.system] + b[1:] for b, v in key.videos.items()})


def _title(study: ExportFolders) -> None:
    change_data(study, lambda data: data.update(title="Globalnet against the rest"))
    index = study.bundle / INDEX
    index.write_text(index.read_text().replace("Which moves better?", "Globalnet against the rest"))
    media.set_fixed_mtime(index)


def _always_left(study: ExportFolders) -> None:
    key = read_key(study.key)

    def change(data: dict) -> None:
        for page in (page for pages in data["lists"] for page in pages):
            page[1].sort(key=lambda blind: SYSTEMS.index(key.videos[blind].system))

    change_data(study, change)


def _script(study: ExportFolders) -> None:
    path = study.bundle / "study.js"
    path.write_text(path.read_text() + "// globalnet first\n")
    media.set_fixed_mtime(path)


def _key_in_bundle(study: ExportFolders) -> None:
    shutil.copy(study.key, study.bundle / "key.json")
    media.set_fixed_mtime(study.bundle / "key.json")
    media.set_fixed_mtime(study.bundle)


def _slightly_larger_files(study: ExportFolders) -> None:
    """Within two percent, and always in the same order."""
    for clip in CLIPS:
        for number, system in enumerate(SYSTEMS):
            pad(study, system, clip, 8 + 20 * number)


def _bit_rate(study: ExportFolders) -> None:
    """A picture of fewer bytes in a file of the old size."""
    video = video_of(study, "localnet", "kitchen")
    size = video.stat().st_size
    changed("kitchen", "-c:v", "libx264", "-crf", "45", "-bf", "0")(study)
    pad(study, "localnet", "kitchen", size - video.stat().st_size)


def put_stream(study: ExportFolders, clip: str, frames: list[list[bytes]]) -> None:
    """In the place of the picture of one video, in a file of the old size."""
    video, stream = video_of(study, "localnet", clip), study.private / "changed.h264"
    size = video.stat().st_size
    stream.write_bytes(media.join_units(frames))
    media.mux_mp4(stream, None, video)
    missing = size - video.stat().st_size
    if missing < 8:
        accept_video(study, video)
    else:
        pad(study, "localnet", clip, missing)


def _packets(study: ExportFolders) -> None:
    """As many bytes in all, filled up at the end alone."""
    frames = media.split_into_frames(media.video_stream(video_of(study, "localnet", "street")))
    own = [[unit for unit in units if unit[0] & 31 != 6] for units in frames]
    own[-1][:0] = [unit for units in frames for unit in units if unit[0] & 31 == 6]
    put_stream(study, "street", own)


def _filling(study: ExportFolders) -> None:
    """Packets as large as the others', of a picture that needed less."""
    video, out = video_of(study, "localnet", "office"), study.private / "changed.h264"
    sizes = [
        sum(4 + len(unit) for unit in units)
        for units in media.split_into_frames(media.video_stream(video))
    ]
    media.encode_video_stream(video, out, SIZE, 0.5)
    frames = media.split_into_frames(out.read_bytes())
    for units, size in zip(frames, sizes, strict=True):
        missing = size - sum(4 + len(unit) for unit in units)
        if missing > 6:
            units.insert(-1, b"\x0c" + b"\xff" * (missing - 6) + b"\x80")
    put_stream(study, "office", frames)


def test_a_sound_study_has_no_leak(silent_study, spoken_study, capsys):
    assert find_leaks(spoken_study) == []
    assert main(["study", "check", str(silent_study)]) == 0
    assert capsys.readouterr().out == "No leak was found.\n"


def told(change: Callable[[dict], object]) -> Plant:
    """Changes what the page's script reads."""
    return lambda study: change_data(study, change)


def _order_of_trials(data: dict) -> None:
    data.update(trials=dict(sorted(data["trials"].items(), reverse=True)))


ADDRESS, PLACE = "https://host/a.mp4", ["x", ["media/RECORDED/x.mp4"]]
LEAKS: list[tuple[str, Plant, str]] = [
    ("files", _key_in_bundle, "stray file: key.json"),
    ("files", lambda s: video_of(s, "localnet", "garden").unlink(), "missing file: media/"),
    (
        "files",
        lambda s: video_of(s, "localnet", "street").write_bytes(b"x"),
        "changed file: media/",
    ),
    ("page", _always_left, "order on the screen: 'localnet' is first in"),
    (
        "page",
        told(lambda data: next(iter(data["trials"].values())).update(system="globalnet")),
        "JSON: the page's data contain 'globalnet'",
    ),
    ("page", told(_order_of_trials), "JSON: the trials are not sorted"),
    (
        "page",
        told(lambda data: data.update(conditions=[1])),
        "contain the unknown field `conditions`",
    ),
    (
        "page",
        told(lambda data: data["lists"][0][0].append(ADDRESS)),
        "JSON: the page's data contain a URL",
    ),
    (
        "page",
        told(lambda data: data["lists"][0].append(PLACE)),
        "JSON: the page's data contain 'rec",
    ),
    ("page", _title, "text: `title` contains 'globalnet'"),
    ("page", _script, "page: study.js was changed; it differs from the version"),
    ("names", _names_in_order, "file name: sorting the videos by file name reveals the system"),
    (
        "metadata",
        changed("kitchen", *COPY, "-metadata", "title=localnet"),
        "{kitchen} contains a `udta`",
    ),
    ("metadata", bool, "{kitchen} contains the name 'localnet'"),
    (
        "metadata",
        changed("garden", "-c", "copy", "-metadata", "creation_time=2026-01-01T00:00:00"),
        "{garden} contains its creation time",
    ),
    (
        "metadata",
        changed("street", *COPY, "-metadata:s:v:0", "handler_name=run 17"),
        "the tracks of {street} have unusual handler names (run 17",
    ),
    (
        "metadata",
        changed("office", "-c:v", "libx264", "-b:v", "100k"),
        "{office} contains an encoder tag",
    ),
    (
        "time",
        lambda study: video_of(study, "localnet", "garden").touch(),
        "time stamp: the modification time of {garden} differs",
    ),
    (
        "time",
        lambda s: rename_videos(s, {video_of(s, "recorded", "garden").stem: "localnet-1"}),
        "file name: media/localnet-1.mp4",
    ),
    (
        "sizes",
        lambda study: pad(study, "localnet", "garden", 900),
        "size: the videos of clip 'garden'",
    ),
    ("sizes", _bit_rate, "bit rate: the videos of clip 'kitchen' differ by"),
    ("sizes", _packets, "packet sizes: not the same in all videos of clip 'street'"),
    ("sizes", _filling, "unpadded size: the videos of clip 'office' differ by"),
    ("sizes", bool, "compressed size: the videos of clip 'office'"),
    ("larger", _slightly_larger_files, "size: sorting the videos by size reveals the system"),
    (
        "length",
        changed("garden", *COPY, "-frames:v", "14"),
        "frames: not the same in all",
    ),
    (
        "length",
        changed("street", *SINE, "-map", "0:v", "-map", "1:a", "-c:v", "copy"),
        "{street} has sound in a study without sound",
    ),
    (
        "sound",
        changed("garden", "-c:v", "copy", "-c:a", "aac", "-b:a", "64k"),
        "differs between its videos",
    ),
    ("sound", changed("kitchen", "-c:v", "copy", "-an"), "{kitchen} has no sound."),
]
"""Groups that are planted together, each with what is said of it; in braces is the file of the
first system's video of a clip."""


@pytest.mark.parametrize("group", dict.fromkeys(group for group, *_ in LEAKS))
def test_planted_leaks_are_found(silent_study, spoken_study, tmp_path, group):
    is_spoken = group == "sound"
    study = copy_study(spoken_study if is_spoken else silent_study, tmp_path / "study")
    clips = CLIPS[:2] if is_spoken else CLIPS
    names = {clip: f"media/{video_of(study, SYSTEMS[0], clip).name}" for clip in clips}
    planted = [(plant, sentence) for each, plant, sentence in LEAKS if each == group]
    for plant, _ in planted:
        plant(study)
    found = "\n".join(find_leaks(tmp_path / "study"))
    for _, sentence in planted:
        if "{" in sentence:
            sentence = sentence.format(**names)
        assert sentence in found


def test_the_command_fails_loudly_and_names_the_leak(silent_study, tmp_path, capsys):
    study = copy_study(silent_study, tmp_path / "study")
    video_of(study, "localnet", "garden").touch()
    assert main(["study", "check", str(tmp_path / "study")]) == 1
    said = capsys.readouterr()
    assert said.out == "" and said.err.startswith(
        "LEAK time stamp: the modification time of media/"
    )
    assert said.err.endswith("1 leak was found; do not host this bundle.\n")


def test_a_damaged_unfinished_or_missing_study_gives_a_sentence(silent_study, tmp_path):
    with pytest.raises(RunError, match="There is no study in"):
        find_leaks(tmp_path)
    study = copy_study(silent_study, tmp_path / "study")
    (study.bundle / DATA).write_text("window.STUDY = {")
    media.set_fixed_mtime(study.bundle / DATA)
    with pytest.raises(RunError, match="was changed after the export"):
        find_leaks(tmp_path / "study")
    digest = next(iter(read_key(study.key).videos.values())).sha256
    study.key.write_text(study.key.read_text().replace(digest, "not made yet"))
    with pytest.raises(RunError, match="is not finished; run `study export` again"):
        find_leaks(tmp_path / "study")
