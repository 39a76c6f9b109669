from collections.abc import Callable
from typing import Any

import pytest

from torquebench.bench.drivers import open_drivers
from torquebench.bench.drivers.base import Identity
from torquebench.bench.interlocks import check_identities
from torquebench.errors import BenchError


def test_instruments_that_are_the_described_ones_pass(describe: Callable[..., Any]) -> None:
    description = describe(driver__reference="readout")
    check_identities(description, open_drivers(description).identities())


def test_another_instrument_is_refused_by_its_serial(describe: Callable[..., Any]) -> None:
    other = Identity("output.drive", "somebody", "servo drive", "4711")
    with pytest.raises(BenchError, match="'4711'; allowed: serial 'SIM-DRIVE-OUT'"):
        check_identities(describe(), [other])
