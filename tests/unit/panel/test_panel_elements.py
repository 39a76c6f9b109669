"""Work beside the event loop of the pages."""

import asyncio
from concurrent.futures import ThreadPoolExecutor

import pytest
from nicegui import core, run

from torquebench.panel.components.elements import in_thread


def test_a_value_and_an_error_arrive_and_the_end_of_the_panel_ends_the_task(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async def work() -> None:
        assert await in_thread(divmod, 7, 2) == (3, 1)
        assert await in_thread(lambda: None) is None
        with pytest.raises(ZeroDivisionError):
            await in_thread(divmod, 7, 0)
        monkeypatch.setattr(type(core.app), "is_stopping", True)
        with pytest.raises(asyncio.CancelledError):
            await in_thread(divmod, 7, 2)

    with ThreadPoolExecutor(1) as threads:
        monkeypatch.setattr(run, "thread_pool", threads)
        asyncio.run(work())
