"""Small studies for tests: motion and sound from formulas, and a stand-in for the renderer."""

import json
import shutil
import subprocess
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from app.study.design.key import read_key, write_key
from app.study.design.plan import read_study_plan
from app.study.export import export_study
from app.study.make.bundle import DATA, DATA_START
from app.study.make.export_folders import ExportFolders
from app.study.make.media import set_fixed_mtime
from model.motion.motion import save_motion
from model.speech.audio import write_wav
from model.storage.files import file_sha256
from renderer.video.encoder import ffmpeg_path
from tests.helpers import smooth_motion_example
from tests.model.made import made_waveform

SYSTEMS = ["localnet", "globalnet", "recorded"]
CLIPS = ["kitchen", "garden", "street", "office"]
FRAMES = 15
SIZE = 64


def write_inputs(
    folder: Path, systems: Sequence[str], clips: Sequence[str], frames: int = FRAMES
) -> None:
    """``<clip>.wav`` and ``<system>-<clip>.npz``, all different."""
    folder.mkdir(parents=True, exist_ok=True)
    for c, clip in enumerate(clips):
        samples = made_waveform(16_000 * frames // 30 + 100 * c)[-(16_000 * frames // 30) :]
        write_wav(folder / f"{clip}.wav", samples)
        for s, system in enumerate(systems):
            save_motion(
                smooth_motion_example(frames, seed=100 * c + s), folder / f"{system}-{clip}.npz"
            )


def write_plan(
    folder: Path, systems: Sequence[str], clips: Sequence[str], settings: str = ""
) -> Path:
    """A plan for the files of `write_inputs`; ``settings`` come first and win."""
    defaults = {
        "title": '"Which moves better?"',
        "protocol": '"pairwise"',
        "participants": "4",
        "size": str(SIZE),
    }
    lines = [f"{k} = {v}" for k, v in defaults.items() if f"{k} =" not in settings]
    lines = [settings, *lines]
    for clip in clips:
        lines += ["[[clips]]", f'name = "{clip}"', f'speech = "{clip}.wav"']
    for system in systems:
        lines += ["[[systems]]", f'name = "{system}"', f'motion = "{system}-{{clip}}.npz"']
    path = folder / "plan.toml"
    path.write_text("\n".join(lines) + "\n")
    return path


def draw_noise(
    jobs,
    on_progress,
    on_done,
    should_cancel,
    on_start: Callable[[str], None] = bool,
    seeds: Sequence[int] = (),
) -> None:
    """In place of `renderer.video.workers.run_render_jobs`: noise, as much as each motion decides.

    Args:
        seeds: by number of the motion, in place of what it decides.
    """
    for number, (name, job) in enumerate(jobs.items()):
        on_start(name)
        seed = seeds[number] if seeds else int(np.abs(job.motion.poses).sum() * 1e3)
        rng = np.random.default_rng(seed)
        shape = (job.motion.num_frames, job.settings.height, job.settings.width, 3)
        pictures = rng.integers(0, 1 + seed % 200, shape, np.uint8)
        command = [
            *(ffmpeg_path(), "-v", "error", "-y", "-f", "rawvideo", "-pixel_format", "rgb24"),
            *("-video_size", f"{shape[2]}x{shape[1]}", "-framerate", "30", "-i", "pipe:0"),
            *("-c:v", "libx264", "-crf", "0", "-preset", "ultrafast", "-threads", "1"),
            *("-pix_fmt", "yuv420p", str(job.out)),
        ]
        subprocess.run(command, input=pictures.tobytes(), check=True)
        on_done(name)
        on_progress((number + 1) / len(jobs))


def make_study(
    folder: Path, systems: Sequence[str], clips: Sequence[str], settings: str = ""
) -> Path:
    """A whole export in ``folder/study``."""
    write_inputs(folder, systems, clips)
    plan = read_study_plan(write_plan(folder, systems, clips, settings))
    export_study(plan, folder / "study", draw=draw_noise)
    return folder / "study"


def copy_study(study: Path, out: Path) -> ExportFolders:
    """A copy to plant something in; times are kept."""
    shutil.copytree(study, out)
    return ExportFolders(out)


def video_of(folders: ExportFolders, system: str, clip: str) -> Path:
    """One of the videos that shows this."""
    videos = read_key(folders.key).videos.items()
    blind = next(name for name, v in videos if (v.system, v.clip) == (system, clip))
    return folders.video(blind)


def accept_video(folders: ExportFolders, video: Path) -> None:
    """Make the key say that a changed video is as it should be."""
    key = read_key(folders.key)
    changed = replace(key.videos[video.stem], sha256=file_sha256(video))
    write_key(replace(key, videos={**key.videos, video.stem: changed}), folders.key)
    set_fixed_mtime(video)


def rename_videos(folders: ExportFolders, names: dict[str, str]) -> None:
    """Give videos other names, wherever they are written."""
    text = folders.key.read_text()
    data = (folders.bundle / DATA).read_text()
    for old, new in names.items():
        folders.video(old).rename(folders.video(new))
        text, data = text.replace(old, new), data.replace(old, new)
    folders.key.write_text(text)
    (folders.bundle / DATA).write_text(data)
    set_fixed_mtime(folders.bundle / DATA)
    set_fixed_mtime(folders.media)


def change_data(folders: ExportFolders, change: Callable[[dict], None]) -> None:
    """Change what the page's script reads."""
    path = folders.bundle / DATA
    data = json.loads(path.read_text().removeprefix(DATA_START).rstrip().removesuffix(";"))
    change(data)
    path.write_text(f"{DATA_START}{json.dumps(data)};\n")
    set_fixed_mtime(path)


def ffmpeg(*arguments: str) -> None:
    subprocess.run([ffmpeg_path(), "-v", "error", "-y", *arguments], check=True)


def tree(folder: Path) -> dict[str, tuple[bytes, float]]:
    """Everything in a folder: contents and times."""
    return {
        path.relative_to(folder).as_posix(): (path.read_bytes(), path.stat().st_mtime)
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }
