"""Each leak is planted in a copy of a sound study, and found by name."""

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
    SIZE,
    accept_video,
    change_data,
    copy_study,
    ffmpeg,
    make_study,
    rename_videos,
    video_of,
)

SYSTEMS = ["localnet", "globalnet", "recorded"]
CLIPS = ["kitchen", "garden", "street", "office"]


@pytest.fixture(scope="module")
def silent_study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Twelve videos: enough for an order to be told from chance."""
    return make_study(tmp_path_factory.mktemp("silent"), SYSTEMS, CLIPS)


@pytest.fixture(scope="module")
def spoken_study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Right and wrong speech."""
    folder = tmp_path_factory.mktemp("spoken")
    return make_study(folder, SYSTEMS[:2], CLIPS[:2], 'protocol = "matched"')


def changed(*arguments: str) -> Callable[[Workspace], None]:
    """Puts one video through ffmpeg, and lets the key take the result for right."""

    def change(study: Workspace) -> None:
        video, out = video_of(study, "localnet", "garden"), study.private / "changed.mp4"
        ffmpeg("-i", str(video), *arguments, "-movflags", "+faststart", str(out))
        shutil.move(out, video)
        accept_video(study, video)

    return change


def pad(study: Workspace, system: str, clip: str, num_bytes: int) -> None:
    video = video_of(study, system, clip)
    with video.open("ab") as file:
        file.write(num_bytes.to_bytes(4, "big") + b"free" + bytes(num_bytes - 8))
    accept_video(study, video)


COPY = ("-c", "copy", "-fflags", "+bitexact")
SINE = ("-f", "lavfi", "-i", "sine=duration=0.5")


def _telling_name(study: Workspace) -> None:
    rename_videos(study, {video_of(study, "localnet", "garden").stem: "localnet-1"})


def _names_in_order(study: Workspace) -> None:
    """Random digits behind a first one that follows the system."""
    key = read_key(study.key)
    place = {name: str(i) for i, name in enumerate(SYSTEMS)}
    rename_videos(study, {b: place[v.system] + b[1:] for b, v in key.videos.items()})


def _system_in_json(study: Workspace) -> None:
    def change(data: dict) -> None:
        next(iter(data["trials"].values()))["system"] = "globalnet"

    change_data(study, change)


def _part_of_a_name_in_json(study: Workspace) -> None:
    change_data(study, lambda data: data["lists"][0].append(["x", ["media/RECORDED/x.mp4"]]))


def _unknown_field(study: Workspace) -> None:
    change_data(study, lambda data: data.update(conditions=[1, 2, 3]))


def _order_of_trials(study: Workspace) -> None:
    change_data(
        study, lambda data: data.update(trials=dict(sorted(data["trials"].items(), reverse=True)))
    )


def _url_in_json(study: Workspace) -> None:
    change_data(study, lambda data: data["lists"][0][0].append("https://host/a.mp4"))


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


def _changed_video(study: Workspace) -> None:
    video_of(study, "localnet", "garden").write_bytes(b"other")


def _time_stamp(study: Workspace) -> None:
    video_of(study, "localnet", "garden").touch()


def _large_file(study: Workspace) -> None:
    video = video_of(study, "localnet", "garden")
    pad(study, "localnet", "garden", round(0.03 * video.stat().st_size))


def _slightly_larger_files(study: Workspace) -> None:
    """Within two percent, and always in the same order."""
    for clip in CLIPS:
        for number, system in enumerate(SYSTEMS):
            pad(study, system, clip, 8 + 20 * number)


def _bit_rate(study: Workspace) -> None:
    """A picture of fewer bytes in a file of the old size."""
    video = video_of(study, "localnet", "garden")
    size = video.stat().st_size
    changed("-c:v", "libx264", "-crf", "45", "-bf", "0")(study)
    pad(study, "localnet", "garden", size - video.stat().st_size)


def encoded(study: Workspace, system: str, share: float) -> list[list[bytes]]:
    """The video's pictures at another share of the rate, as units of each."""
    out = study.private / "changed.h264"
    media.encode_picture(video_of(study, system, "garden"), out, SIZE, share)
    return frames_of(out.read_bytes())


def put_stream(study: Workspace, system: str, frames: list[list[bytes]]) -> None:
    """In the place of the picture of one video, in a file of the old size."""
    video, stream = video_of(study, system, "garden"), study.private / "changed.h264"
    size = video.stat().st_size
    stream.write_bytes(joined(frames))
    media.join(stream, None, video)
    missing = size - video.stat().st_size
    if missing < 8:
        accept_video(study, video)
    else:
        pad(study, system, "garden", missing)


def _packets(study: Workspace) -> None:
    """As many bytes in all, filled up at the end alone."""
    video = video_of(study, "localnet", "garden")
    frames = frames_of(media.picture_stream(video))
    own = [[unit for unit in units if unit[0] & 31 != 6] for units in frames]
    own[-1][:0] = [unit for units in frames for unit in units if unit[0] & 31 == 6]
    put_stream(study, "localnet", own)


def _filling(study: Workspace) -> None:
    """Packets as large as the others', of a picture that needed less."""
    video = video_of(study, "localnet", "garden")
    sizes = [
        sum(4 + len(unit) for unit in units) for units in frames_of(media.picture_stream(video))
    ]
    frames = encoded(study, "localnet", 0.5)
    for units, size in zip(frames, sizes, strict=True):
        missing = size - sum(4 + len(unit) for unit in units)
        if missing > 6:
            units.insert(-1, b"\x0c" + b"\xff" * (missing - 6) + b"\x80")
    put_stream(study, "localnet", frames)


def _loud_sound(study: Workspace) -> None:
    for video in sorted(study.media.iterdir()):
        out = study.private / "changed.mp4"
        ffmpeg("-i", str(video), "-c:v", "copy", "-af", "volume=-9dB", "-c:a", "aac", str(out))
        shutil.move(out, video)
        accept_video(study, video)


LEAKS: dict[str, tuple[Callable[[Workspace], None], str]] = {
    "a telling file name": (_telling_name, "file name: media/localnet-1.mp4"),
    "names in the systems' order": (_names_in_order, "file name: its order follows the system"),
    "a system in the JSON": (_system_in_json, "JSON: the page's data hold 'globalnet'"),
    "a name in a path": (_part_of_a_name_in_json, "JSON: the page's data hold 'recorded'"),
    "an unknown field": (_unknown_field, "JSON: the field `conditions` is unknown"),
    "trials in order of making": (_order_of_trials, "JSON: the trials do not stand in the order"),
    "an address": (_url_in_json, "URL: the page's data hold an address"),
    "a title that names a system": (_title, "text: `title` holds 'globalnet'"),
    "a side": (_always_left, "order on the screen: 'localnet' stands first"),
    "another script": (_script, "page: study.js is not the file of this program"),
    "the key in the bundle": (_key_in_bundle, "stray file: key.json"),
    "a lost video": (
        lambda study: video_of(study, "localnet", "garden").unlink(),
        "missing file: media/",
    ),
    "another video": (_changed_video, "changed file: media/"),
    "a title in the metadata": (changed(*COPY, "-metadata", "title=localnet"), "has a `udta` box"),
    "a time in the metadata": (
        changed("-c", "copy", "-metadata", "creation_time=2026-01-01T00:00:00"),
        "holds the time at which it was made",
    ),
    "a stream's name": (
        changed(*COPY, "-metadata:s:v:0", "handler_name=run 17"),
        "names its streams run 17",
    ),
    "an encoder's note": (changed("-c:v", "libx264", "-b:v", "100k"), "holds an encoder's note"),
    "a time stamp": (_time_stamp, "time stamp: media/"),
    "a large file": (_large_file, "size: the videos of clip 'garden' differ by"),
    "slightly larger files": (_slightly_larger_files, "size: its order follows the system"),
    "a bit rate": (_bit_rate, "bit rate: the videos of clip 'garden' differ by"),
    "sizes of packets": (_packets, "packet sizes: the videos of clip 'garden' differ"),
    "filling up": (_filling, "filling: the videos of clip 'garden' differ by"),
    "filling that can be compressed": (_filling, "compressed size: the videos of clip 'garden'"),
    "a shorter video": (
        changed(*COPY, "-frames:v", "14"),
        "frames: the videos of clip 'garden' differ",
    ),
    "sound in a silent study": (
        changed(*SINE, "-map", "0:v", "-map", "1:a", "-c:v", "copy"),
        "has sound, unlike the others",
    ),
}
LEAKS_OF_SOUND: dict[str, tuple[Callable[[Workspace], None], str]] = {
    "another encoding of the sound": (
        changed("-c:v", "copy", "-c:a", "aac", "-b:a", "64k"),
        "is not the same stream in every video",
    ),
    "a silent video": (changed("-c:v", "copy", "-an"), "has no sound, unlike the others"),
    "another loudness": (_loud_sound, "LUFS in place of -23"),
}


def test_a_sound_study_has_no_leak(silent_study: Path, spoken_study: Path) -> None:
    assert check_study(silent_study) == []
    assert check_study(spoken_study) == []


@pytest.mark.parametrize("leak", [*LEAKS, *LEAKS_OF_SOUND])
def test_a_planted_leak_is_found(
    silent_study: Path, spoken_study: Path, tmp_path: Path, leak: str
) -> None:
    plant, words = (LEAKS | LEAKS_OF_SOUND)[leak]
    plant(copy_study(silent_study if leak in LEAKS else spoken_study, tmp_path / "study"))
    found = check_study(tmp_path / "study")
    assert any(words in sentence for sentence in found), found


def test_the_command_fails_loudly_and_names_the_leak(
    silent_study: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["study", "check", str(silent_study)]) == 0
    assert capsys.readouterr().out == "No leak was found.\n"
    _time_stamp(copy_study(silent_study, tmp_path / "study"))
    assert main(["study", "check", str(tmp_path / "study")]) == 1
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.startswith("LEAK time stamp: media/")
    assert said.err.endswith("1 leak was found; do not host this bundle.\n")


def test_an_unfinished_or_missing_study_gives_a_sentence(
    silent_study: Path, tmp_path: Path
) -> None:
    with pytest.raises(RunError, match="There is no study in"):
        check_study(tmp_path)
    study = copy_study(silent_study, tmp_path / "study")
    digest = next(iter(read_key(study.key).videos.values())).sha256
    study.key.write_text(study.key.read_text().replace(digest, "not made yet"))
    with pytest.raises(RunError, match="is not finished; run it again"):
        check_study(tmp_path / "study")


def test_damaged_data_give_a_sentence(silent_study: Path, tmp_path: Path) -> None:
    study = copy_study(silent_study, tmp_path / "study")
    (study.bundle / DATA).write_text("window.STUDY = {")
    set_time(study.bundle / DATA)
    with pytest.raises(RunError, match="is not what the export wrote"):
        check_study(tmp_path / "study")
