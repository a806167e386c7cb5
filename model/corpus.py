"""Former name of the command ``python -m tools.corpus``, accepted in this version."""

import runpy
import sys

if __name__ == "__main__":
    sys.stderr.write(
        "python -m model.corpus is now python -m tools.corpus; the former name will be removed.\n"
    )
    runpy.run_module("tools.corpus", run_name="__main__")
