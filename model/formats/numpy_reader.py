"""Numpy files: archives of BEAT2, AMASS, SMPL-X parameters and their variants; single arrays."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Shaped
from scipy.spatial.transform import Rotation, Slerp

from conventions.joints import FACE, HANDS, JOINT_INDEX, JOINT_NAMES, NUM_JOINTS
from conventions.names import join_names, printable
from conventions.rates import FPS
from model.formats.motion_draft import (
    BODY,
    JOINTS_BY_COUNT,
    ROTATION_FORMATS,
    SET_NAMES,
    HandReferencePrior,
    MotionDraft,
    RotationLayout,
    are_positions,
    rotation_layout,
    scatter_joints,
)
from model.formats.parameters import (
    EMBODY3D_MASK,
    EXPRESSIONS,
    PARAMETER_JOINTS,
    POSES,
    RATES,
    ROOTS,
    TRANSLATIONS,
    VALID,
    sibling_parameter_files,
    split_key,
)
from model.formats.reading import Assumption, Confidence, Part
from model.motion.motion import MAX_FRAMES, NUM_BETAS, NUM_EXPRESSIONS, check_num_frames, read_basis
from model.motion.runs import true_runs
from model.storage.npz import (
    MAX_ABS_VALUE,
    MAX_FILE_BYTES,
    Header,
    MotionError,
    check_size,
    open_archive,
    read_array,
    read_headers,
    read_npy_file,
)

_BEAT2 = {"poses", "trans", "expressions", "betas", "mocap_frame_rate"}
_DIFFSHEG = tuple(
    JOINT_INDEX[name]
    for name in (
        *("spine1", "spine2", "spine3", "neck", "left_collar", "right_collar", "head"),
        *("left_shoulder", "right_shoulder", "left_elbow", "right_elbow"),
        *("left_wrist", "right_wrist"),
        *(JOINT_NAMES[joint] for joint in HANDS),
        "jaw",
    )
)


@dataclass(frozen=True)
class ColumnLayout:
    """A layout of columns: joints (``values_per_joint`` numbers each) and named blocks."""

    description: str
    blocks: tuple[tuple[tuple[int, ...] | str, int], ...]
    hand_reference_prior: HandReferencePrior = "unknown"
    """See `MotionDraft.hand_reference_prior`."""
    missing_parts: tuple[Part, ...] = ()
    no_translation_reason: str = ""
    """Reason why its translation is not read."""
    values_per_joint: int = 3


_ALL = JOINTS_BY_COUNT[55]
COLUMN_LAYOUTS: dict[int, ColumnLayout] = {
    265: ColumnLayout(
        "columns of TalkSHOW: jaw, eyes, global orientation, body, hands, expression",
        (((22,), 3), ((23, 24), 6), (BODY, 66), (HANDS, 90), ("expression", 100)),
        hand_reference_prior="usually mean",
    ),
    232: ColumnLayout(
        "columns of DiffSHEG on TalkSHOW's data: upper body, hands, jaw, expression; pelvis, legs "
        "and eyes stay at rest",
        ((_DIFFSHEG, 3 * len(_DIFFSHEG)), ("expression", 100)),
        hand_reference_prior="usually mean",
        missing_parts=("legs", "place"),
    ),
    322: ColumnLayout(
        "columns of Motion-X: root, body, hands, jaw, expression, face shape, translation, betas",
        ((BODY, 66), (HANDS, 90), ((22,), 3), ("expression", 50), ("", 100), ("trans", 3),
         ("betas", 10)),
        hand_reference_prior="usually mean",
    ),
    268: ColumnLayout(
        "columns for 55 joints, translation, expression",
        ((_ALL, 165), ("trans", 3), ("expression", 100)),
    ),
    168: ColumnLayout("columns for 55 joints and translation", ((_ALL, 165), ("trans", 3))),
    75: ColumnLayout(
        "columns for SMPL's 24 joints and translation",
        ((BODY, 66), ("", 6), ("trans", 3)),
        missing_parts=("hands",),
    ),
    333: ColumnLayout(
        "columns for 55 joints as 6D and translation",
        ((_ALL, 330), ("trans", 3)),
        values_per_joint=6,
    ),
    337: ColumnLayout(
        "internal columns of EMAGE: 55 joints as 6D, translation, contacts",
        ((_ALL, 330), ("", 7)),
        missing_parts=("place",),
        no_translation_reason="the array does not say whether its translation is a position or a"
        " velocity, so it is not read",
        values_per_joint=6,
    ),
}  # fmt: skip
"""Layouts by the number of columns."""
UNSUPPORTED_LAYOUTS = {
    104: "has the 104 angles per frame of Audio2Photoreal. Its skeleton is defined only by the "
    "model in its checkpoints, and no public list says which angle rotates which joint, so the "
    "angles cannot be converted to SMPL-X",
    141: "has the 141 numbers per frame of DiffSHEG on BEAT: Euler angles, normalised with a mean "
    "and a standard deviation that are not in the file. Give the .bvh file that DiffSHEG writes",
    263: "has the 263 numbers per frame of HumanML3D (root velocities, positions, velocities), "
    "whose rotations were fitted to positions. Convert it to SMPL with joints2smpl, and give "
    "the result",
    251: "has the 251 numbers per frame of KIT-ML (21 joints, without SMPL's rotations). Convert "
    "it to SMPL with joints2smpl, and give the result",
    623: "has the 623 numbers per frame of HumanTOMATO (positions and velocities). Give the "
    "Motion-X file with 322 numbers per frame from which it was made",
    **dict.fromkeys(
        (768, 1024),
        "seems to contain speech features (wav2vec 2.0, HuBERT or WavLM) instead of motion",
    ),
    **dict.fromkeys(
        (29, 36),
        "seems to contain a motion of the robot Unitree G1 (29 joint angles, with or without 7 "
        "numbers of the root), which cannot be converted to a person's joints. Give the human "
        "motion from which it was retargeted (SMPL-X or BVH)",
    ),
    **dict.fromkeys((80, 128), "seems to contain a mel spectrogram instead of motion"),
}
"""Reasons why no motion can be made of arrays, by their width."""
_SOMA = (
    "has the {joints} joints of the skeleton SOMA (NVIDIA's Kimodo and GEM-X), whose rest pose "
    "differs from SMPL-X's. Convert it to BVH (kimodo_convert FILE.npz FILE.bvh), and give the "
    "BVH file"
)
JOINTS_NOT_READ = {
    77: _SOMA,
    30: _SOMA,
    34: "has the {joints} joints of the robot Unitree G1 (as written by Kimodo), which cannot be "
    "converted to a person's joints. Give the human motion from which it was retargeted, or "
    "generate it for SMPL-X",
}
"""Reasons why a skeleton is not read, by its number of joints."""
_PARAMETER_WIDTHS = (3, 10, 16, 45, 63, 300)
CONVERT_PICKLE_COMMAND = (
    'python -c "import numpy as n,sys; f=lambda d,p=str(): {k: v for a,b in d.items() for k,v in '
    "(f(b,p+str(a)+'/') if hasattr(b,'items') else {p+str(a): n.asarray(b)}).items()}; "
    "d=n.load(sys.argv[1],allow_pickle=True); d=dict(d) if hasattr(d,'files') else d; "
    "d=d if hasattr(d,'items') else d.item(); "
    "d={k: v.item() if getattr(v,'dtype',0)==object and v.ndim==0 else v for k,v in d.items()}; "
    "n.savez('motion.npz', **{k: v for k,v in f(d).items() if v.dtype!=object})\" FILE"
)
"""Command for users who trust a file of pickled objects: loading runs any code in them."""
_MAX_TRANSLATION = 1e5
"""Largest coordinate: a hundred metres in millimetres."""
_SUPPORTED_SHAPES = (
    "rotations must have the shape (frames, 165) or (frames, 55, 3), or have 53, 52, 24 or 22"
    " joints with 3, 4, 6 or 9 numbers each"
)
_IN_A_FOLDER = (
    "If it holds one parameter of a motion (global_orient, body_pose, transl, ...), give the "
    "folder of all files of the motion, or a zip of that folder."
)


def read_npz(path: Path, overrides: dict[str, str]) -> MotionDraft:
    """Read a BEAT2 npz, or a variant that can be converted; raises MotionError for all else."""
    with open_archive(path) as archive:
        return _Archive(archive, path.name, overrides).read()


def _read_parameter_files(
    files: Mapping[str, Path], name: str, overrides: dict[str, str]
) -> MotionDraft:
    if sum(file.stat().st_size for file in files.values()) > MAX_FILE_BYTES:
        raise MotionError(
            f"The files of {name} have more than {MAX_FILE_BYTES // 2**20} MiB in total; give a "
            "shorter motion."
        )
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        for part, file in files.items():
            archive.writestr(f"{part}.npy", file.read_bytes())
    with open_archive(next(iter(files.values())), content) as archive:
        return _Archive(archive, name, overrides).read()


def read_npy(path: Path, overrides: dict[str, str]) -> MotionDraft:
    """Read a motion from one array, or a file for each parameter; raises MotionError."""
    check_size(path)
    if files := sibling_parameter_files(path):
        return _read_parameter_files(files, path.name, overrides)
    try:
        array = read_npy_file(path)
    except OSError as error:
        raise MotionError(f"{path.name} could not be read: {error.strerror or error}.") from error
    if array is not None and array.dtype.kind in "fiub" and array.ndim < 2:
        raise MotionError(
            f"{path.name} has the shape {array.shape}, one number per frame; {_SUPPORTED_SHAPES}. "
            f"{_IN_A_FOLDER}"
        )
    if array is None or array.dtype.kind not in "fiu":
        raise MotionError(
            f"{path.name} is not an array of numbers with one row per frame. Pickled objects are "
            "never loaded, because they could run code. If you trust the file, convert it with: "
            f"{CONVERT_PICKLE_COMMAND}."
        )
    draft = _of_array(array.astype(np.float32), path.name, overrides)
    _rate(draft, {})
    _note_missing(draft)
    return draft


def _of_array(
    array: Shaped[np.ndarray, " ..."], name: str, overrides: dict[str, str], key: str = ""
) -> MotionDraft:
    """Read a motion from one array that holds everything."""
    named = f"`{key}` of {name}" if key else name
    width = array.shape[-1]
    shape = rotation_layout(array.shape)
    if (
        shape is not None
        and shape.is_transposed
        and width in (*COLUMN_LAYOUTS, *UNSUPPORTED_LAYOUTS)
    ):
        shape = None
    if shape is None and array.ndim < 4 and width in UNSUPPORTED_LAYOUTS:
        raise MotionError(f"{named} {UNSUPPORTED_LAYOUTS[width]}.")
    if shape is None and array.ndim in (2, 3) and width in COLUMN_LAYOUTS:
        return _of_columns(array, COLUMN_LAYOUTS[width], name, overrides)
    if shape is None:
        if reason := unsupported_skeleton_reason(array.shape):
            raise MotionError(f"{named} {reason}.")
        folder = f" {_IN_A_FOLDER}" if width in _PARAMETER_WIDTHS and not key else ""
        raise MotionError(f"{named} has the shape {array.shape}; {_SUPPORTED_SHAPES}.{folder}")
    return _of_rotations(array, shape, name, overrides)


def unsupported_skeleton_reason(shape: tuple[int, ...]) -> str:
    """Return the reason why an array's skeleton is not read, and what to do, or ""."""
    match shape:
        case (*_, joints, 3, 3) if joints in JOINTS_NOT_READ:
            pass
        case (_, joints, width) if (
            joints in JOINTS_NOT_READ and width in ROTATION_FORMATS and joints != 30
        ):
            pass  # 30 joints of 3 numbers are two hands
        case _:
            return ""
    return JOINTS_NOT_READ[joints].format(joints=joints)


def _of_columns(
    array: Shaped[np.ndarray, "*batch T C"],
    layout: ColumnLayout,
    name: str,
    overrides: dict[str, str],
) -> MotionDraft:
    draft = MotionDraft(
        name,
        overrides,
        np.zeros((1, NUM_JOINTS, 3)),
        hand_reference_prior=layout.hand_reference_prior,
    )
    draft.assume("layout", str(array.shape[-1]), layout.description)
    rows = _select_motion(draft, array.reshape(-1, *array.shape[-2:]))
    check_num_frames(len(rows), name)
    _check_finite(draft, "the array", rows, most=_MAX_TRANSLATION)
    poses = np.zeros((len(rows), NUM_JOINTS, 3))
    start = 0
    for what, count in layout.blocks:
        block = rows[:, start : start + count]
        start += count
        if isinstance(what, tuple):
            poses[:, list(what)] = draft.to_axis_angle(
                block.reshape(len(rows), -1, layout.values_per_joint), what
            )
        elif what == "expression":
            draft.expressions = np.pad(block, ((0, 0), (0, NUM_EXPRESSIONS - count)))
        elif what == "trans":
            draft.trans = block.astype(np.float64)
        elif what == "betas":
            draft.betas[:count] = block[0]
    draft.poses = poses
    draft.missing_parts |= set(layout.missing_parts)
    if layout.no_translation_reason:
        draft.assume("place", "none", layout.no_translation_reason, "unsure")
    return draft


def _of_rotations(
    array: Shaped[np.ndarray, " ..."], shape: RotationLayout, name: str, overrides: dict[str, str]
) -> MotionDraft:
    check_num_frames(shape.frames, name)
    draft = MotionDraft(
        name, overrides, np.zeros((1, NUM_JOINTS, 3)), hand_reference_prior="unknown"
    )
    rows = _select_motion(draft, shape.reshape(array))
    if shape.is_transposed:
        reason = f"frames lie along the second axis of {array.shape}"
        draft.assume("layout", "transposed", reason, "unsure")
    _check_finite(draft, "rotations", rows)
    joints = JOINTS_BY_COUNT[shape.joints]
    if shape.values_per_joint == 3 and are_positions(rows, joints):
        raise MotionError(
            f"{name} contains joint positions, not rotations (its bones have constant lengths). "
            "Fit SMPL-X to them (for instance with joints2smpl or SMPLify-X), or save the "
            "rotations."
        )
    draft.poses = scatter_joints(draft.to_axis_angle(rows[:, : len(joints)], joints), joints)
    _assume_joints(draft, joints, f"as many joints as {SET_NAMES[shape.joints]}")
    return draft


def _assume_joints(draft: MotionDraft, joints: tuple[int, ...], reason: str) -> None:
    if not set(HANDS) & set(joints):
        draft.missing_parts.add("hands")
    lacking = [
        words
        for words, of in (("fingers", HANDS), ("jaw", FACE[:1]), ("eyes", FACE[1:]))
        if not set(of) & set(joints)
    ]
    rest = f"; {', '.join(lacking)} stay at rest" if lacking else ""
    draft.assume("joints", str(len(set(joints))), reason + rest, "stated", (), not lacking)


def _select_motion(draft: MotionDraft, batch: Shaped[np.ndarray, " N *motion"]) -> np.ndarray:
    """Return the motion of a batch that the user chose, or the first."""
    count = len(batch)
    if count == 1:
        return batch[0]
    choice = draft.overrides.get("motion", "1")
    if not choice.isdigit() or not 1 <= int(choice) <= count:
        raise MotionError(
            f"{draft.name} contains {count} motions; choose one by its number (--assume motion=1 "
            f"to motion={count})."
        )
    alternatives = tuple(str(number) for number in range(1, count + 1))
    reason = f"the file contains a batch of {count} motions"
    confidence = "user" if "motion" in draft.overrides else "unsure"
    draft.assume("motion", choice, reason, confidence, alternatives)
    draft.motion_number = int(choice)
    return batch[draft.motion_number - 1]


def _check_finite(
    draft: MotionDraft, noun: str, rows: Shaped[np.ndarray, "T ..."], most: float = MAX_ABS_VALUE
) -> None:
    """Raise MotionError for frames that are not finite, or interpolate them if requested."""
    flat = rows.reshape(len(rows), -1)
    bad = np.asarray(~np.isfinite(flat).all(axis=1))
    if bad.any() and draft.overrides.get("frames") == "bridge" and not bad.all():
        good = np.flatnonzero(~bad)
        for column in range(flat.shape[1]):
            flat[bad, column] = np.interp(np.flatnonzero(bad), good, flat[good, column])
        draft.assume(
            "frames",
            "bridge",
            f"frames {format_frame_ranges(bad)} of {noun} were interpolated",
            "user",
        )
    elif bad.any():
        raise MotionError(
            f"{draft.name} contains NaN or infinite values in {noun}, in frames "
            f"{format_frame_ranges(bad)}; repair the file (or use --assume frames=bridge to "
            "interpolate them)."
        )
    largest = float(np.abs(flat).max(initial=0.0))
    if largest > most:
        raise MotionError(
            f"{draft.name} contains the value {largest:.3g} in {noun}, above the limit of {most:g};"
            " use radians and metres."
        )


def format_frame_ranges(marks: Shaped[np.ndarray, " T"]) -> str:
    """Format the ranges of set marks, for example ``3, 40-45``."""
    pairs = true_runs(marks.astype(bool))
    named = [f"{a}-{b - 1}" if b - a > 1 else str(a) for a, b in pairs[:8]]
    return ", ".join(named) + (f" and {len(pairs) - 8} more" if len(pairs) > 8 else "")


@dataclass
class _Archive:
    """An archive with its arrays by their plain names, without prefixes."""

    archive: zipfile.ZipFile
    name: str
    overrides: dict[str, str]
    headers: dict[str, Header] = field(default_factory=dict)
    key_by_plain_name: dict[str, str] = field(default_factory=dict)
    """Key of each plain name."""
    motion_choice: Assumption | None = None
    """Choice of one of several motions."""
    lengths: dict[str, int] = field(default_factory=dict)
    """Number of rows of each parameter that is read."""

    def read(self) -> MotionDraft:
        self.headers = read_headers(self.archive, self.name, allow_objects=True)
        chosen = self._choose()
        draft = self._poses(chosen)
        if self.motion_choice is not None:
            draft.assumptions.append(self.motion_choice)
        objects = [key for key, (_, dtype) in self.headers.items() if dtype.hasobject]
        if objects:
            draft.assume("layout", "npz", f"{self._listed(objects)} are pickled objects, not read")
        if draft.trans is None and (key := self._find(TRANSLATIONS)):
            trans = self._array(draft, key, 3)
            self.lengths[key] = len(trans)
            _check_finite(draft, f"`{key}`", trans, most=_MAX_TRANSLATION)
            draft.trans = trans.astype(np.float64)
        if draft.expressions is None and (key := self._find(EXPRESSIONS)):
            self._expressions(draft, key)
        self._betas(draft)
        _rate(draft, {key: self._rate_of(key) for key in RATES if key in self.key_by_plain_name})
        self._of_one_length(draft)
        self._invalid(draft)
        if _BEAT2 <= set(self.key_by_plain_name) and self.headers[self.key_by_plain_name["poses"]][
            0
        ][-1:] == (165,):
            draft.hand_reference_prior = "flat"
        draft.expression_basis = read_basis(self.archive, self.headers, self.name)
        _note_missing(draft)
        return draft

    def _of_one_length(self, draft: MotionDraft) -> None:
        """Extend parameters of one row to all frames, and cut others to the shortest."""
        frames = _num_frames(self.lengths)
        single = [f"`{key}`" for key, length in self.lengths.items() if length == 1]
        if frames > 1 and single:
            have = "have" if len(single) > 1 else "has"
            reason = f"{join_names(single)} {have} one row, which is used for all frames"
            draft.assume("frames", str(frames), reason)
        by_length: dict[int, list[str]] = {}
        for key, length in self.lengths.items():
            by_length.setdefault(length, []).append(key)
        by_length.pop(1, None)
        if len(by_length) > 1:
            lengths = ", ".join(f"{n} of {join_names(keys)}" for n, keys in by_length.items())
            draft.assume(
                "frames",
                str(frames),
                f"lengths differ ({lengths}); the first {frames} frames were used",
            )
        draft.poses = _of_length(draft.poses, frames)
        if draft.trans is not None:
            draft.trans = _of_length(draft.trans, frames)
        if draft.expressions is not None:
            draft.expressions = _of_length(draft.expressions, frames)

    def _choose(self) -> str:
        """Return the key of the poses (or of ``global_orient``), by the user's choice of several.

        The plain names are set to the arrays that belong to it.
        """
        candidates: dict[str, str] = {}
        for names in (POSES, ROOTS):
            for key, (shape, dtype) in self.headers.items():
                before, plain = split_key(key)
                is_one = plain in names and dtype.kind in "fiu"
                if is_one and (not before or names is ROOTS or _is_motion(shape)):
                    candidates.setdefault(before, key)
        if not candidates:
            usable = [
                key
                for key, (shape, dtype) in self.headers.items()
                if dtype.kind in "fiu" and _is_motion(shape)
            ]
            usable = [
                key for key in usable if self.headers[key][0][-1] not in UNSUPPORTED_LAYOUTS
            ] or usable
            if len(usable) != 1:
                raise MotionError(self._nothing())
            candidates = {"": usable[0]}
        before = next(iter(candidates))
        if len(candidates) > 1 and ("" not in candidates or "motion" in self.overrides):
            names = [printable(each or "(no prefix)") for each in candidates]
            choice = self.overrides.get("motion", "")
            numbers = [str(number) for number in range(1, len(names) + 1)]
            if choice not in (*candidates, *numbers):
                raise MotionError(
                    f"{self.name} contains {len(candidates)} motions: {', '.join(names[:12])}; "
                    "choose one by name or number (--assume motion=1)."
                )
            before = choice if choice in candidates else list(candidates)[numbers.index(choice)]
            self.motion_choice = Assumption("motion", choice, "set by you", "user", tuple(names))
        elif len(candidates) > 1:
            before = ""
            others = tuple(each for each in candidates if each)
            reason = f"`{candidates['']}` was read; the file also contains {', '.join(others)}"
            self.motion_choice = Assumption(
                "motion", printable(candidates[""]), reason, "likely", others
            )
        for own in (False, True):  # arrays of no other motion, then those of this one
            for key in self.headers:
                prefix, plain = split_key(key)
                if prefix == before if own else prefix not in candidates or not prefix:
                    self.key_by_plain_name[plain] = key
        return candidates[before]

    def _nothing(self) -> str:
        objects = [key for key, (_, dtype) in self.headers.items() if dtype.hasobject]
        if objects:
            return (
                f"{self.name} contains pickled Python objects in {self._listed(objects)}, which are"
                " never loaded, because they could run code. If you trust the file, convert it"
                f" with: {CONVERT_PICKLE_COMMAND}."
            )
        for shape, _ in self.headers.values():
            if reason := unsupported_skeleton_reason(shape) or (
                len(shape) == 2 and UNSUPPORTED_LAYOUTS.get(shape[-1], "")
            ):
                return f"{self.name} {reason}."
        return (
            f"{self.name} has neither poses nor `global_orient` with `body_pose`: it contains"
            f" {self._listed(list(self.headers)) or 'nothing'}; {_SUPPORTED_SHAPES}."
        )

    def _listed(self, keys: list[str]) -> str:
        named = [f"{printable(key[:40])} {self.headers[key][0]}" for key in keys[:16]]
        return ", ".join(named) + (" and more" if len(keys) > 16 else "")

    def _find(self, names: tuple[str, ...]) -> str | None:
        return next((name for name in names if name in self.key_by_plain_name), None)

    def _poses(self, key: str) -> MotionDraft:
        shape, _ = self.headers[key]
        plain = split_key(key)[1]
        if 0 in shape:
            raise MotionError(
                f"{self.name} has no frames: `{printable(key)}` has the shape {shape}."
            )
        if plain in ROOTS:
            return self._of_parts()
        if not _is_motion(shape):
            raise MotionError(
                f"{self.name}: `{printable(key)}` has the shape {shape}; {_SUPPORTED_SHAPES}. The "
                f"file contains {self._listed(list(self.headers))}."
            )
        if max(shape[:2]) > MAX_FRAMES:
            check_num_frames(max(shape[:2]), self.name)
        array = self._numbers(key)
        draft = _of_array(array, self.name, self.overrides, printable(key))
        self.lengths["poses"] = len(draft.poses)
        if plain != "poses":
            draft.assume(
                "layout", printable(key), f"this array of shape {shape} contains rotations"
            )
        return draft

    def _of_parts(self) -> MotionDraft:
        """Read a motion from separate SMPL-X parameters; missing ones stay at rest."""
        draft = MotionDraft(
            self.name,
            self.overrides,
            np.zeros((1, NUM_JOINTS, 3)),
            hand_reference_prior="usually mean",
        )
        parts: dict[tuple[int, ...], np.ndarray] = {}
        keys = []
        for part, joints in PARAMETER_JOINTS.items():
            if part not in self.key_by_plain_name or not self._is_number(part):
                continue
            rows = self._part_rows(part, self._filled(part), len(joints))
            check_num_frames(len(rows), self.name)
            _check_finite(draft, f"`{part}`", rows)
            parts[joints] = rows
            keys.append(part)
            self.lengths[part] = len(rows)
        frames = _num_frames(self.lengths)
        if not set(BODY[1:]) <= {joint for joints in parts for joint in joints}:
            raise MotionError(
                f"{self.name} has `global_orient` but no `body_pose`; both are needed."
            )
        joints = tuple(joint for of in parts for joint in of)
        poses = np.zeros((frames, NUM_JOINTS, 3))
        widths = {rows.shape[-1] for rows in parts.values()}
        groups = [list(parts)] if len(widths) == 1 else [[of] for of in parts]
        for group in groups:
            these = tuple(joint for of in group for joint in of)
            rows = np.concatenate([_of_length(parts[of], frames) for of in group], axis=1)
            poses[:, list(these)] = draft.to_axis_angle(rows, these)
        draft.poses = poses
        draft.assume("layout", "parts", f"combined from {', '.join(keys)}", "stated")
        _assume_joints(draft, joints, "SMPL-X's parameters")
        return draft

    def _part_rows(self, part: str, array: Shaped[np.ndarray, "N ..."], joints: int) -> np.ndarray:
        """Reshape a part to (T, joints, numbers)."""
        each, over = divmod(int(np.prod(array.shape[1:])), joints)
        if len(array) == 1 and array.ndim > 2 and (over or each not in ROTATION_FORMATS):
            return self._part_rows(part, array[0], joints)
        smpl = array.reshape(len(array), -1)
        if part in ("body_pose", "pose_body") and smpl.shape[1] == 69:
            return smpl[:, :63].reshape(len(array), 21, 3)
        if over or each not in ROTATION_FORMATS:
            reason = (
                " Hands as PCA components need the licensed model: save them with use_pca=False, or"
                " convert the num_pca_comps coefficients to 45 numbers with the model's hand"
                " components."
            )
            reason = reason if "hand" in part else ""
            raise MotionError(
                f"{self.name}: `{part}` must have {3 * joints} numbers per frame (or 4, 6 or 9 for "
                f"each of {joints} joints); it has the shape {array.shape}.{reason}"
            )
        return smpl.reshape(len(array), joints, each)

    def _is_number(self, plain: str) -> bool:
        return self.headers[self.key_by_plain_name[plain]][1].kind in "fiu"

    def _numbers(self, key: str) -> np.ndarray:
        _, dtype = self.headers[key]
        if dtype.kind not in "fiu":
            raise MotionError(f"{self.name}: `{key}` must contain numbers; it contains {dtype}.")
        return read_array(self.archive, key).astype(np.float32)

    def _filled(self, plain: str) -> np.ndarray:
        """Return an array with at least two axes that is not empty; a vector is one row."""
        array = self._numbers(self.key_by_plain_name[plain])
        if not array.size:
            raise MotionError(f"{self.name}: `{plain}` is empty; it has the shape {array.shape}.")
        return np.atleast_2d(array)

    def _array(self, draft: MotionDraft, plain: str, columns: int) -> np.ndarray:
        """Return an array with one row per frame, of the motion that was chosen of a batch."""
        array = self._filled(plain)
        shape = array.shape
        if array.ndim == 3 and array.shape[1] != 1:
            array = array[min(draft.motion_number, len(array)) - 1]
        if array.ndim == 2 and array.shape[1] != columns and array.shape[0] == columns:
            array = array.T
        array = array.reshape(len(array), -1)
        if array.shape[1] != columns:
            raise MotionError(
                f"{self.name}: `{plain}` must have the shape (frames, {columns}); it has {shape}."
            )
        check_num_frames(len(array), self.name)
        return array

    def _expressions(self, draft: MotionDraft, plain: str) -> None:
        shape, dtype = self.headers[self.key_by_plain_name[plain]]
        columns = shape[-1] if shape else 0
        if dtype.kind not in "fiu" or len(shape) < 2 or not 0 < columns <= NUM_EXPRESSIONS:
            reason = (
                f"`{plain}` {shape} does not contain 1 to {NUM_EXPRESSIONS} FLAME coefficients per "
                "frame"
            )
            draft.assume("face", "none", f"{reason}; the face stays at rest")
            return
        face = self._array(draft, plain, columns)
        self.lengths[plain] = len(face)
        _check_finite(draft, f"`{plain}`", face)
        draft.expressions = np.pad(face, ((0, 0), (0, NUM_EXPRESSIONS - columns)))
        if columns < NUM_EXPRESSIONS or plain != "expressions":
            draft.assume("face", "flame", f"`{plain}` {shape} was read as FLAME coefficients")

    def _betas(self, draft: MotionDraft) -> None:
        if "betas" not in self.key_by_plain_name:
            return
        shape, dtype = self.headers[self.key_by_plain_name["betas"]]
        if dtype.kind not in "fiu" or 0 in shape or not shape or shape[-1] > NUM_BETAS:
            draft.assume("shape", "mean", f"`betas` {shape} of {dtype} is not a body shape")
            return
        betas = self._numbers(self.key_by_plain_name["betas"]).reshape(-1, shape[-1])[0]
        if not np.isfinite(betas).all() or np.abs(betas).max() > MAX_ABS_VALUE:
            draft.assume("shape", "mean", "`betas` has values that are NaN, infinite or too large")
            return
        draft.betas[: len(betas)] = betas
        if len(shape) > 1:
            draft.assume("shape", "betas", f"the first row of `betas` {shape} was used", "likely")

    def _rate_of(self, plain: str) -> str:
        """Return the value of one of `RATES` as text."""
        key = self.key_by_plain_name[plain]
        shape, dtype = self.headers[key]
        if dtype.kind not in "fiuUS" or int(np.prod(shape)) != 1 or dtype.itemsize > 400:
            return ""
        value = read_array(self.archive, key).reshape(-1)[0]
        return value.decode("latin1") if isinstance(value, bytes) else str(value)

    def _invalid(self, draft: MotionDraft) -> None:
        """Report frames that a mask marks as invalid; those of `EMBODY3D_MASK` are interpolated."""
        key = self._find((*VALID, EMBODY3D_MASK))
        if key is None or self.headers[self.key_by_plain_name[key]][1].kind not in "buif":
            return
        marks = np.zeros(len(draft.poses), dtype=bool)
        values = read_array(self.archive, self.key_by_plain_name[key]).reshape(-1)[: len(marks)]
        marks[: len(values)] = values == 0
        confidence: Confidence = "stated"
        if (
            key == EMBODY3D_MASK and marks.mean() > 0.5
        ):  # then zero rather means that nothing is missing
            marks[: len(values)] = values != 0
            confidence = "unsure"
        choice = self.overrides.get("frames", "bridge" if key == EMBODY3D_MASK else "refuse")
        if not marks.any() or marks.all():
            return
        which = f"`{key}` marks frames {format_frame_ranges(marks)} as invalid"
        if choice == "bridge":
            _bridge(draft, marks)
            draft.assume("frames", "bridge", f"{which}; they were interpolated", confidence)
        else:
            reason = f"{which}; they were not changed (--assume frames=bridge interpolates them)"
            draft.assume("frames", "as-is", reason, confidence)


def _num_frames(lengths: Mapping[str, int]) -> int:
    """Return the number of frames that all parameters have; one row fits any number."""
    return min((length for length in lengths.values() if length > 1), default=1)


def _of_length(rows: Shaped[np.ndarray, "T ..."], frames: int) -> np.ndarray:
    return np.repeat(rows, frames, axis=0) if len(rows) == 1 else rows[:frames]


def _bridge(draft: MotionDraft, marks: Bool[np.ndarray, " T"]) -> None:
    """Interpolate marked frames from their neighbours; the nearest is repeated at the ends."""
    good, bad = np.flatnonzero(~marks), np.flatnonzero(marks)
    at = bad.clip(good[0], good[-1])
    if len(good) == 1:
        draft.poses[bad] = draft.poses[good]
    else:
        for joint in range(NUM_JOINTS):
            turns = Slerp(good, Rotation.from_rotvec(draft.poses[good, joint]))
            draft.poses[bad, joint] = turns(at).as_rotvec()
    for rows in (draft.trans, draft.expressions):
        for column in () if rows is None else rows.T:
            column[bad] = np.interp(at, good, column[good])


def _is_motion(shape: tuple[int, ...]) -> bool:
    is_layout = rotation_layout(shape) or (
        len(shape) in (2, 3) and shape[-1] in (*COLUMN_LAYOUTS, *UNSUPPORTED_LAYOUTS)
    )
    return bool(is_layout)


def _rate(draft: MotionDraft, stated: dict[str, str]) -> None:
    """Set the frame rate from the file, or the default."""
    numbers: dict[str, float] = {}
    for key, value in stated.items():
        try:
            numbers[key] = float(value)
        except ValueError:
            continue
    values = {f"{value:g}" for value in numbers.values()}
    if not numbers:
        reason = (
            "the file does not state one"
            if not stated
            else f"`{next(iter(stated))}` is not a number"
        )
        draft.set_frame_rate(float(FPS), reason, "unsure")
        return
    key, fps = next(iter(numbers.items()))
    if len(values) > 1:
        rates = ", ".join(f"`{key}` says {value:g}" for key, value in numbers.items())
        draft.set_frame_rate(fps, rates, "unsure", tuple(sorted(values)))
    else:
        draft.set_frame_rate(fps, f"from `{key}`", "stated")


def _note_missing(draft: MotionDraft) -> None:
    """Record which parts are missing."""
    if draft.expressions is None:
        draft.missing_parts.add("face")
        if not any(each.kind == "face" for each in draft.assumptions):
            draft.assume("face", "none", "the file has no expressions; the face stays at rest")
    if draft.trans is None and "place" not in draft.missing_parts:
        draft.missing_parts.add("place")
        draft.assume("place", "none", "the file has no translation; the body stays in one place")
