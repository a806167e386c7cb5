"""Command ``convert``: motion files of any supported format, converted to another one."""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from tyro.conf import Positional, arg

from app.config import body_from_environment
from app.errors import RunError, message_for_user
from app.flags import File
from app.run.batch.pairing import is_visible_with_suffix
from app.run.models import get_body
from app.run.output.console import print_message, print_path
from app.run.requests.convert import refuse_ignored
from app.run.requests.parts import OverridesFlag
from conventions.names import printable, safe_file_stem
from model.formats.parameters import files_with_motion_names
from model.formats.reading import ImportOverrides

if TYPE_CHECKING:
    from model.formats.reading import ImportedMotion

FORMS = (".npz", ".bvh", ".glb", ".vrma")


@dataclass(frozen=True)
class ConvertRequest:
    """Input files, output and options of a conversion."""

    files: Annotated[
        Positional[tuple[Path, ...]], arg(metavar="FILE", help_behavior_hint="(required)")
    ]
    """Motion files of any supported format, or folders or zips of them."""
    out: Path
    """Output file (.npz, .bvh, .glb, .vrma), or a folder for all outputs."""
    to: Literal[".npz", ".bvh", ".glb", ".vrma"] = ".npz"
    """File format for a folder of outputs."""
    import_overrides: OverridesFlag = field(default_factory=ImportOverrides)
    body: File = field(default_factory=body_from_environment)
    """A character (.vrm, .glb), which .glb output animates; or a licensed
    SMPLX_NEUTRAL*.npz, which sets the mean hand pose and the skeleton of .bvh and .glb output."""
    flame_to_arkit_matrix: Annotated[File, arg(name="flame-to-arkit")] = None
    """BEAT2's mat_final.npy, to convert FLAME face coefficients to ARKit weights."""
    prints_json: Annotated[bool, arg(name="json")] = False
    """Write the assumptions made for each file as JSON."""


def convert(request: Annotated[ConvertRequest, arg(name="")]) -> None:
    """Convert motion files to BEAT2 npz, BVH, glTF or VRMA.

    Motions are converted to 55 joints at 30 frames per second, in metres, y up, with hand rotations
    relative to the flat hand. Assumptions about the files are reported. Files that cannot be read
    are reported and skipped (exit status 1).
    """
    written = convert_files(request)
    failed = [each for each in written if "error" in each]
    if request.prints_json:
        sys.stdout.write(json.dumps(written, indent=1) + "\n")
    for each in written:
        for sentence in [each["error"]] if "error" in each else each["notes"]:
            print_message(sentence)
        if "out" in each and not request.prints_json:
            print_path(Path(each["out"]))
    if failed:
        raise RunError(f"{len(failed)} of {len(written)} files were not converted (see above).")


def convert_files(request: ConvertRequest) -> list[dict[str, Any]]:
    """Convert all readable files, and return for each the assumptions or the reason of the refusal.

    Raises RunError, BodyError, WriteError, each with one sentence.
    """
    from app.run.batch.archives import unpack_archives
    from model.formats.read import ENDINGS

    is_file = request.out.suffix.lower() in FORMS
    missing = next((path for path in request.files if not path.exists()), None)
    if missing is not None:
        raise RunError(f"{missing} does not exist.")
    if is_file:
        why = f"--out names a {request.out.suffix.lower()} file, which sets the format"
        refuse_ignored(request, ("to",), why, to=request.out.suffix.lower())
    packed = [(path, ENDINGS) for path in request.files if not path.is_dir()]
    if is_file:
        request.out.parent.mkdir(parents=True, exist_ok=True)
    else:
        request.out.mkdir(parents=True, exist_ok=True)
    beside = request.out.parent if is_file else request.out
    with tempfile.TemporaryDirectory(dir=beside) as staging:
        folders = unpack_archives(packed, Path(staging))
        paths = list(_motion_paths(request.files, folders, ENDINGS))
        if not paths:
            raise RunError(f"The inputs contain no motion file ({', '.join(ENDINGS)}).")
        if is_file and len(paths) != 1:
            raise RunError(
                f"--out names a single file, but the inputs contain {len(paths)} motions; give a "
                "folder instead."
            )
        request.import_overrides.check_files_exist(
            [path for path, _ in paths], *(str(name) for _, name in paths)
        )
        outs = [request.out] if is_file else _outs(request, [name for _, name in paths])
        return [
            _convert_record(path, name, out, request)
            for (path, name), out in zip(paths, outs, strict=True)
        ]


def _motion_paths(
    files: Sequence[Path], folders: dict[Path, Path], endings: tuple[str, ...]
) -> Iterator[tuple[Path, Path]]:
    """Yield the path of each motion file and its name below its folder or zip."""
    for source in files:
        folder = folders.get(source, source)
        if not folder.is_dir():
            yield source, Path(source.name)
            continue
        for path, name in files_with_motion_names(folder):
            if is_visible_with_suffix(endings, name):
                yield path, name


def _outs(request: ConvertRequest, names: Sequence[Path]) -> list[Path]:
    """Return the output path of each name; repeated names get a number."""
    outs: list[Path] = []
    for name in names:
        stem = request.out.joinpath(*map(safe_file_stem, (*name.parent.parts, name.stem)))
        out = stem.with_name(f"{stem.name}{request.to}")
        number = 2
        while out in outs:
            out = stem.with_name(f"{stem.name}_{number}{request.to}")
            number += 1
        outs.append(out)
    return outs


def _convert_record(path: Path, name: Path, out: Path, request: ConvertRequest) -> dict[str, Any]:
    record: dict[str, Any] = {"file": printable(str(name))}
    try:
        if out.resolve() in {each.resolve() for each in request.files}:
            raise RunError(f"{out} would overwrite an input file; choose another --out.")
        reading = _written(path, str(name), out, request)
    except Exception as error:
        sentence = message_for_user(error)
        if sentence is None:
            raise
        return record | {"error": sentence}
    return record | {
        "out": str(out),
        "frames": reading.motion.num_frames,
        "assumptions": [each.as_json() for each in reading.assumptions],
        "missing_parts": sorted(reading.missing_parts),
        "notes": list(reading.notes),
    }


def _written(path: Path, name: str, out: Path, request: ConvertRequest) -> ImportedMotion:
    from app.run.bodies import body_motion
    from model.formats.read import read_any_motion
    from model.motion.flame import flame_to_arkit, read_flame_matrix
    from model.motion.motion import save_motion
    from model.storage.files import written_atomically
    from renderer.files.character_glb import character_glb_bytes
    from renderer.files.exports import write_bvh
    from renderer.files.vrma import vrma_bytes

    reading = read_any_motion(path, request.import_overrides, request.body, name)
    if request.flame_to_arkit_matrix is not None:
        matrix = read_flame_matrix(request.flame_to_arkit_matrix)
        reading = replace(reading, motion=flame_to_arkit(reading.motion, matrix))
    out.parent.mkdir(parents=True, exist_ok=True)
    if out.suffix.lower() == ".npz":
        assumptions = json.dumps([each.as_json() for each in reading.assumptions])
        save_motion(reading.motion, out, assumptions=assumptions)
    else:
        body, motion = get_body(request.body), body_motion(reading.motion)
        with written_atomically(out) as part:
            if out.suffix.lower() == ".bvh":
                write_bvh(body, motion, part)
            else:
                write = vrma_bytes if out.suffix.lower() == ".vrma" else character_glb_bytes
                part.write_bytes(write(body, motion))
    return reading
