"""Command ``python -m model.corpus``, implemented in `tools.corpus`."""

import sys

from tools.corpus.build import main

if __name__ == "__main__":
    sys.exit(main())
