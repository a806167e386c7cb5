"""From the last minute of a live session to an ordinary run."""

from __future__ import annotations

from typing import Any

from app.page.queue.jobs import Job
from app.page.tabs.generate.generate_form import PAGE_SIZE_PX
from app.page.tabs.generate.generate_run import GenerateRunner
from app.run.requests.display import Display
from app.run.requests.request import GenerateRequest, Take
from conventions.views import CLOSE_UPS

_MAX_TOKEN = 100


class LiveRunner(GenerateRunner):
    """Keeps what a visitor has spoken and seen."""

    tab = "live"

    def _kept_values(self, job: Job, values: tuple[Any, ...]) -> dict[str, Any]:
        return {}  # the form of the tab "Motion" cannot ask for it again

    def asked(self, job: Job, cookie: str, values: tuple[Any, ...]) -> GenerateRequest:
        """Sound, motion and plan of the last minute, laid into the job's folder.

        Raises:
            RunError: if there is nothing to keep.
        """
        from model.motion.motion import save_motion
        from model.speech.audio import write_wav

        config = self._services.config
        token = values[0] if isinstance(values[0], str) else ""
        session, kept = self._services.live.kept(token[:_MAX_TOKEN], cookie)
        wav, npz, plan = (job.folder / f"live.{ending}" for ending in ("wav", "npz", "plan.json"))
        write_wav(wav, kept.minute.waveform)
        save_motion(kept.minute.motion, npz)
        if kept.minute.plan is not None:
            kept.minute.plan.write(plan)
        return GenerateRequest(
            speech=wav,
            out=job.folder / "results",
            weights=config.weights,
            systems=(session.ask.system,),
            speaker=session.ask.speaker,
            seed=session.ask.seed,
            body=config.body,
            display=Display(has_trail=True),
            size=PAGE_SIZE_PX,
            close_ups=CLOSE_UPS,
            has_posters=True,
            max_speech_s=config.max_speech_s,
            take=Take(npz, kept.facts, kept.why_less, plan if kept.minute.plan else None),
        )
