"""``python -m model.corpus.report``."""

import sys

from model.corpus.report.report import main

if __name__ == "__main__":
    sys.exit(main())
