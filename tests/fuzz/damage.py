"""What a stranger may send: damaged bytes, values of any kind in the place of others."""

import copy
import io
import zipfile
from typing import Any

import numpy as np
from hypothesis import strategies as st

HUGE = 10**399
WILD: st.SearchStrategy[Any] = st.one_of(
    st.none(),
    st.booleans(),
    st.sampled_from([0, -1, 1, 1.5, 2**31, 2**63, HUGE, -HUGE, 1e308, 5e-324]),
    st.floats(),
    st.text(max_size=20),
    st.sampled_from(["", "\x1b[31m", "\u202e", "\ud800", "../../etc/passwd", "a" * 3000, "NaN"]),
    st.lists(st.integers() | st.text(max_size=3), max_size=3),
    st.dictionaries(st.text(max_size=5), st.integers() | st.none(), max_size=3),
    st.integers(1, 3).map(lambda depth: nested(60 * depth)),
)
WILD_WORDS = [
    *(
        b"0",
        b"-1",
        b"1",
        b"3",
        b"6",
        b"7",
        b"1e308",
        b"nan",
        b"inf",
        b"1,5",
        b"9" * 400,
        b"{",
        b"}",
    ),
    *(b"ROOT", b"JOINT", b"End", b"CHANNELS", b"OFFSET", b"MOTION", b"Xrotation", b"Frames:"),
]


def nested(depth: int) -> Any:
    value: Any = []
    for _ in range(depth):
        value = [value]
    return value


@st.composite
def damaged(draw: st.DrawFn, data: bytes) -> bytes:
    """The bytes with a few places changed, left out, doubled or cut off."""
    for _ in range(draw(st.integers(1, 4))):
        at = draw(st.integers(0, max(0, len(data) - 1)))
        length = draw(st.sampled_from([1, 1, 2, 4, 16, 200]))
        kind = draw(st.sampled_from(["change", "insert", "leave out", "double", "cut off"]))
        if kind == "change":
            new = draw(st.binary(min_size=length, max_size=length))
            data = data[:at] + new + data[at + length :]
        elif kind == "insert":
            data = data[:at] + draw(st.binary(max_size=length)) + data[at:]
        elif kind == "leave out":
            data = data[:at] + data[at + length :]
        elif kind == "double":
            data = data[:at] + data[at : at + length] * draw(st.integers(2, 40)) + data[at:]
        else:
            data = data[:at]
    return data


@st.composite
def damaged_lines(draw: st.DrawFn, text: bytes) -> bytes:
    """The text with a few lines or words replaced by others of it, doubled, moved or left out."""
    lines = text.splitlines()
    for _ in range(draw(st.integers(1, 3))):
        at = draw(st.integers(0, max(0, len(lines) - 1)))
        other = draw(st.sampled_from(lines)) if lines else b""
        words, wild = lines[at].split() if lines else [], draw(st.sampled_from(WILD_WORDS))
        how = draw(st.sampled_from(["double", "leave out", "move", "word", "word", "fewer"]))
        if how == "word" and words:
            words[draw(st.integers(0, len(words) - 1))] = wild
            lines[at] = b" ".join(words)
        elif how == "fewer":
            lines[at : at + 1] = [b" ".join(words[:-1])]
        else:
            new = {"double": lines[at : at + 1] * 2, "move": [other]}.get(how, [])
            lines[at : at + 1] = new
    return b"\n".join(lines)


@st.composite
def with_wild_values(draw: st.DrawFn, document: Any) -> Any:
    """A JSON document with some values replaced, left out or doubled, anywhere in it."""
    document = copy.deepcopy(document)
    for _ in range(draw(st.integers(1, 3))):
        place = document
        while True:
            keys = list(place) if isinstance(place, dict) else list(range(len(place)))
            if not keys:
                break
            key = draw(st.sampled_from(keys))
            inner = place[key]
            if isinstance(inner, dict | list) and inner and draw(st.integers(0, 3)):
                place = inner
                continue
            how = draw(st.sampled_from(["replace", "replace", "leave out", "double"]))
            if how == "replace":
                place[key] = draw(WILD)
            elif how == "leave out":
                del place[key]
            elif isinstance(place, list):
                place.append(copy.deepcopy(inner))
            else:
                place[draw(st.text(max_size=5))] = copy.deepcopy(inner)
            break
    return document


NPY_HEADERS = st.one_of(
    st.tuples(
        st.sampled_from(["<f4", "<f8", ">f4", "<i2", "<u8", "|O", "<U7", "|V8", "<c8", "<M8[s]"]),
        st.lists(st.integers(-2, 400), max_size=4).map(tuple),
    ).map(lambda it: {"descr": it[0], "fortran_order": False, "shape": it[1]}),
    st.sampled_from(
        [
            {"descr": "<f4", "fortran_order": False, "shape": (True, 165)},
            {"descr": "<f4", "fortran_order": 1, "shape": (3, 165)},
            {"descr": "<f4", "fortran_order": False, "shape": (3, HUGE)},
            {"descr": "<f4", "fortran_order": False, "shape": (-3, -165)},
            {"descr": [("a", "<f4")], "fortran_order": False, "shape": (3,)},
            {"descr": ("<f4", (165,)), "fortran_order": False, "shape": (3,)},
            {"descr": "<f4", "shape": (3, 165)},
        ]
    ),
)


@st.composite
def wild_npz(draw: st.DrawFn, arrays: dict[str, np.ndarray]) -> bytes:
    """An archive with some arrays of other shapes, types, numbers or names."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", draw(st.sampled_from([0, 8, 12, 14]))) as archive:
        for key, array in arrays.items():
            how = draw(st.sampled_from(["keep"] * 5 + ["header", "values", "shape", "name", "no"]))
            if how == "no":
                continue
            content = io.BytesIO()
            if how == "header":
                header = draw(NPY_HEADERS)
                text = (repr(header) + "\n").encode("latin1")
                content.write(np.lib.format.magic(1, 0) + len(text).to_bytes(2, "little") + text)
                content.write(array.tobytes())
            else:
                if how == "shape":
                    empty = array[:0] if array.ndim else array
                    one = array.reshape(-1)[0]
                    shapes = [array[:1] if array.ndim else array, empty, one, array.reshape(-1)]
                    array = draw(st.sampled_from([*shapes, array[None], array.T]))
                if how == "values" and array.dtype.kind in "fi":
                    array = array.astype(draw(st.sampled_from(["f4", "f8", "i4", "c8", "U5"])))
                    if array.dtype.kind in "fc":
                        wild = draw(st.floats(width=32))
                        array = np.where(array == array.flat[0], np.asarray(wild), array)
                np.save(content, array)
            if how == "name":
                key = draw(
                    st.sampled_from([f"{key}\x1b[2J", f"../{key}", f"{key}\u202e", "a" * 99])
                )
            archive.writestr(f"{key}.npy", content.getvalue())
    return file.getvalue()
