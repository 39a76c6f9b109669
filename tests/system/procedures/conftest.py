"""An open simulated bench, fast, for plans."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from torquebench.station import Station


@pytest.fixture
def station(tmp_path: Path) -> Iterator[Station]:
    with Station.open(None, tmp_path / "data") as opened:
        yield opened
