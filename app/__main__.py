"""Command line entry point, ``python -m app COMMAND ...``."""

import sys

from app.commands.cli import main

if __name__ == "__main__":
    sys.exit(main())
