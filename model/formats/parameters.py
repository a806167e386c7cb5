"""Names of motion parameters, in archives and as file names.

This module needs no array library, so that files can be listed quickly.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from conventions.joints import FACE, HANDS, JOINT_INDEX

_BODY = tuple(range(1, 22))
POSES = ("poses", "pose", "fullpose", "full_pose", "pose_aa", "rotations", "rot6d", "motion")
TRANSLATIONS = ("trans", "transl", "translation", "root_trans", "root_translation", "root_pos")
EXPRESSIONS = ("expressions", "expression", "expr", "exp")
RATES = ("mocap_frame_rate", "mocap_framerate", "fps", "frame_rate", "framerate")
VALID = ("is_valid", "valid", "valid_mask")
"""Names of masks that are zero in frames with failed tracking."""
EMBODY3D_MASK = "missing"
"""Name of Embody-3D's mask, which is, in spite of its name, zero in corrupted frames."""
PARAMETER_JOINTS: dict[str, tuple[int, ...]] = {
    "global_orient": (0,),
    "body_pose": _BODY,
    "jaw_pose": (JOINT_INDEX["jaw"],),
    "leye_pose": (JOINT_INDEX["left_eye"],),
    "reye_pose": (JOINT_INDEX["right_eye"],),
    "left_hand_pose": HANDS[:15],
    "right_hand_pose": HANDS[15:],
    "root_orient": (0,),
    "root_pose": (0,),
    "lhand_pose": HANDS[:15],
    "rhand_pose": HANDS[15:],
    "pose_body": _BODY,
    "pose_jaw": (JOINT_INDEX["jaw"],),
    "pose_eye": FACE[1:],
    "pose_hand": HANDS,
}
"""Joints of SMPL-X's own parameters, then of their names in SMPLer-X and AMASS."""
ROOTS = ("global_orient", "root_orient", "root_pose")
FILE_PARAMETERS = tuple(
    dict.fromkeys(
        (*ROOTS, *PARAMETER_JOINTS, "betas", *TRANSLATIONS, *EXPRESSIONS, *VALID, EMBODY3D_MASK)
    )
)
"""Parameters that may be separate files, the root's first."""


def split_key(key: str) -> tuple[str, str]:
    """Split an array's key into its prefix and its plain name, such as ``gt``, ``poses``."""
    keys = (
        *POSES,
        *TRANSLATIONS,
        *EXPRESSIONS,
        *RATES,
        *VALID,
        EMBODY3D_MASK,
        *PARAMETER_JOINTS,
        "betas",
    )
    for mark in ("/", ":", "."):
        before, separator, after = key.rpartition(mark)
        if separator and after in keys:
            return before, after
    if key in keys:
        return "", key
    suffixes = sorted((name for name in keys if key.endswith(f"_{name}")), key=len)
    return (key[: -len(suffixes[-1]) - 1], suffixes[-1]) if suffixes else ("", key)


def sibling_parameter_files(path: Path) -> dict[str, Path]:
    """Return all files of the motion that a .npy parameter file belongs to, by parameter.

    The root's comes first. The layouts are ``PARAMETER/CLIP.npy``, as in Embody-3D, and
    ``CLIP/PARAMETER.npy``; other files give an empty result.
    """
    folder = path.parent
    layouts = (
        (path.stem, lambda: ((file.stem, file) for file in sorted(folder.glob("*.npy")))),
        (folder.name, lambda: ((f.name, f / path.name) for f in sorted(folder.parent.iterdir()))),
    )
    for name, candidates in layouts:
        if path.suffix.lower() != ".npy" or split_key(name)[1] not in FILE_PARAMETERS:
            continue
        file_by_part = {split_key(each)[1]: file for each, file in candidates() if file.is_file()}
        files = {part: file_by_part[part] for part in FILE_PARAMETERS if part in file_by_part}
        if files.keys() & {"body_pose", "pose_body"} and next(iter(files)) in ROOTS:
            return files
    return {}


def files_with_motion_names(folder: Path) -> Iterator[tuple[Path, Path]]:
    """Yield the files of a folder with their relative names.

    A motion with a file per parameter is yielded once, as its first file with the motion's name.
    """
    for path in sorted(file for file in folder.rglob("*") if file.is_file()):
        name, files = path.relative_to(folder), sibling_parameter_files(path)
        first = next(iter(files.values()), path)
        if not first.is_relative_to(folder) or not files:
            yield path, name
        elif path == first and path.parent == files[list(files)[-1]].parent:
            yield path, name.parent.with_name((name.parent.name or folder.name) + path.suffix)
        elif path == first:
            yield path, name.parent.parent / name.name
