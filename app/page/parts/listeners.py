"""How the page's listeners are heard, as keywords of Gradio's events."""

from typing import Any

PRIVATE: dict[str, Any] = {"api_visibility": "private", "show_progress": "hidden"}
"""By the page alone: no program calls it, and nothing spins while it works."""
AT_ONCE: dict[str, Any] = {"queue": False, **PRIVATE}
"""Before all that waits."""
IN_TURN: dict[str, Any] = {
    "show_progress": "hidden",
    "trigger_mode": "once",
    "concurrency_limit": None,
}
"""Of a run: `app.page.queue.jobs.JobBook` lets them in one by one."""
