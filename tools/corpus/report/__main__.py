"""``python -m tools.corpus.report``."""

import sys

from tools.corpus.report.report import main

if __name__ == "__main__":
    sys.exit(main())
