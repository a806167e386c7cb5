"""What a task of `app.page.queue.worker` tells while it works."""

from app.run.requests.request import Artefact, Event, Progress


class Heard:
    """Takes its events, and says when it shall stop."""

    def __init__(self, stop_at: float = 2.0, count: int = 1) -> None:
        """
        Args:
            stop_at: share from which on so many have been told when it stops.
        """
        self.shares: list[float] = []
        self.files: list[Artefact] = []
        self._stop_at, self._count = stop_at, count

    def take(self, event: Event) -> None:
        if isinstance(event, Progress):
            self.shares.append(event.fraction)
        elif isinstance(event, Artefact):
            self.files.append(event)

    def should_stop(self) -> bool:
        return sum(share >= self._stop_at for share in self.shares) >= self._count
