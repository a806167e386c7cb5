"""What a fresh page shows first, in ``examples/first_look``: made with the bundled weights.
``python -m tests.app.run.made_first_look`` makes it anew."""

import json
import shutil
import tempfile
from pathlib import Path

from app.config import EXAMPLES
from app.run.bodies import PointTracker, align_and_cap_lengths
from app.run.examples import FIRST_LOOK, FIRST_LOOK_METADATA, FIRST_MOTION
from app.run.output.run_folder import SPEECH, RunRecord
from app.run.pipeline import generate
from app.run.requests.parts import DEFAULT_TRACKED_POINT
from app.run.run_writer import open_run_writer
from conventions.names import safe_file_stem
from conventions.rates import SAMPLE_RATE
from model.motion.motion import load_motion
from model.speech.audio import load_speech, write_wav
from model.speech.transcript import EMPTY_TRANSCRIPT
from model.systems.globaldiff.config import PRIORFLOW
from tests.app.requests import generate_request

LOOK_S = 6.7
"""Of the speech, to a pause: whoever opens the page first waits for each second of it."""


def make_first_look(out: Path) -> None:
    """What the best system makes of the beginning of an example."""
    tracker = PointTracker()
    with tempfile.TemporaryDirectory() as temporary:
        beginning = Path(temporary, SPEECH)
        waveform = load_speech(EXAMPLES / "three_reasons.wav").waveform
        write_wav(beginning, waveform[: round(SAMPLE_RATE * LOOK_S)])
        speech = load_speech(beginning)
        ask = generate_request(
            speech=beginning, out=Path(temporary, "run"), systems=(PRIORFLOW,), has_figures=False
        )
        result = generate(ask)
        motion = load_motion(result.out / f"{safe_file_stem(PRIORFLOW)}.npz")
        provenance = json.loads((result.out / "provenance.json").read_text())
    motions = {FIRST_MOTION.stem: motion}
    record = RunRecord(kind="imported", tracked_point=DEFAULT_TRACKED_POINT)
    with open_run_writer(out, record) as run:
        shown, _ = align_and_cap_lengths(motions)
        run.write_timeline(
            run.write_motions_and_make_timeline(shown, speech, tracker, ask.sampling.weights),
            EMPTY_TRANSCRIPT,
        )
        run.detect_plans(shown)
        facts = {"provenance": provenance}
        path = run.folder.new_path(FIRST_LOOK_METADATA)
        path.write_text(json.dumps(facts, indent=1) + "\n")
        run.add_files(path)
        run.finish("")


if __name__ == "__main__":
    shutil.rmtree(FIRST_LOOK, ignore_errors=True)
    make_first_look(FIRST_LOOK)
