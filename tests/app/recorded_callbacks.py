"""Callbacks that record the progress of a task, and can cancel it."""

from app.run.callbacks import RunCallbacks, RunEvent, RunStage, StageProgress


class RecordedCallbacks(RunCallbacks):
    """Callbacks that record progress events, and cancel the task at a share of it."""

    def __init__(self, stop_at: float = 2.0, count: int = 1, stage: RunStage | None = None) -> None:
        """
        Args:
            stop_at: fraction done at which the task is cancelled.
            count: number of events with at least this fraction before that.
            stage: stage of these events; None counts all.
        """
        super().__init__(self.take, self.should_stop)
        self.events: list[StageProgress] = []
        self._stage = stage
        self._stop_at, self._count = stop_at, count

    def take(self, event: RunEvent) -> None:
        if isinstance(event, StageProgress):
            self.events.append(event)

    def should_stop(self) -> bool:
        shares = self.shares if self._stage is None else self.shares_of(self._stage)
        return sum(share >= self._stop_at for share in shares) >= self._count

    @property
    def shares(self) -> list[float]:
        return [each.fraction for each in self.events]

    def shares_of(self, stage: RunStage) -> list[float]:
        return [each.fraction for each in self.events if each.stage == stage]
