"""What a task of `app.page.worker` tells while it works."""

from app.run.callbacks import Progress, RunCallbacks, RunEvent, RunStage


class Heard(RunCallbacks):
    """Takes its events, and says when it shall stop."""

    def __init__(self, stop_at: float = 2.0, count: int = 1, stage: RunStage | None = None) -> None:
        """
        Args:
            stop_at: share from which on so many have been told when it stops.
            stage: of which they are; None of any.
        """
        super().__init__(self.take, self.should_stop)
        self.told: list[Progress] = []
        self._stage = stage
        self._stop_at, self._count = stop_at, count

    def take(self, event: RunEvent) -> None:
        if isinstance(event, Progress):
            self.told.append(event)

    def should_stop(self) -> bool:
        shares = self.shares if self._stage is None else self.shares_of(self._stage)
        return sum(share >= self._stop_at for share in shares) >= self._count

    @property
    def shares(self) -> list[float]:
        return [each.fraction for each in self.told]

    def shares_of(self, stage: RunStage) -> list[float]:
        return [each.fraction for each in self.told if each.stage == stage]
