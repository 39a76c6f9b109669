"""A watcher of progress for tests."""

from collections.abc import Callable

from torquebench.progress import NoProgress

__all__ = ["Watching"]


class Watching(NoProgress):
    """Keeps what it is told, and calls a function with each step reached."""

    def __init__(self, react: Callable[[int, str], object] = lambda _done, _detail: None) -> None:
        self.stages: list[tuple[str, int | None]] = []
        self.reached: list[tuple[int, str]] = []
        self.finished = 0
        self._react = react

    @property
    def done(self) -> list[int]:
        """Steps, in the order they were reached."""
        return [done for done, _ in self.reached]

    def start(self, title: str, total: int | None = None) -> None:
        """Note it."""
        self.stages.append((title, total))

    def reach(self, done: int, detail: str = "") -> None:
        """Note it and react."""
        self.reached.append((done, detail))
        self._react(done, detail)

    def finish(self, detail: str = "") -> None:
        """Note it."""
        super().finish(detail)
        self.finished += 1
