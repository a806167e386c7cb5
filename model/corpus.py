"""``python -m model.corpus``, whose work `tools.corpus` does."""

import sys

from tools.corpus.build import main

if __name__ == "__main__":
    sys.exit(main())
