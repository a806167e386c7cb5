"""What serves all visitors of a page, one of each, as its tabs ask for it."""

from __future__ import annotations

from dataclasses import dataclass, field

from app.config import AppConfig
from app.live.sessions import LiveSessions
from app.page.parts.catalogue import Catalogue
from app.page.player.first_look_shown import FirstLooks
from app.page.queue.jobs import JobBook
from app.page.queue.run_processes import RunProcesses
from app.page.results.kept_runs import KeptRuns
from app.page.results.study_preview import StudyPreviews
from app.page.routes.media import MediaAddresses
from app.page.tabs.upload_check import UploadCheck
from app.page.visitors.researcher_part import Handover


@dataclass(frozen=True)
class Services:
    """Of one page."""

    config: AppConfig
    catalogue: Catalogue
    jobs: JobBook
    processes: RunProcesses
    """Do all runs."""
    check: UploadCheck
    """Of uploads, before there is a run."""
    kept: KeptRuns
    handover: Handover
    live: LiveSessions
    addresses: MediaAddresses = field(default_factory=MediaAddresses)
    previews: StudyPreviews = field(default_factory=StudyPreviews)
    first_look: FirstLooks | None = None
    """What plays before the first run."""
