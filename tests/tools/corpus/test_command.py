"""The corpus's command, by the name under which it is documented."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[3]


def test_the_corpus_is_made_by_its_documented_command(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "model.corpus", "--out", str(tmp_path), "--seed", "1"]
    done = subprocess.run(
        [*command, "--hours", "-1"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 1 and "--hours must be above 0" in done.stderr
