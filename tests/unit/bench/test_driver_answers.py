"""Whatever a wire brings: a number, a missing number or this project's error, nothing else."""

import math
import re
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from torquebench.bench.drivers.modbus import register_map
from torquebench.bench.drivers.modbus.driver import ModbusDrive
from torquebench.bench.drivers.modbus.modules import ModbusReadout
from torquebench.bench.drivers.scpi.link import NO_NUMBER, ScpiLink, numbers
from torquebench.errors import BenchError

NRF = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")
WORD = st.integers(0, 0xFFFF)
PRINTABLE = st.text(st.characters(min_codepoint=32, max_codepoint=126), max_size=60)


@given(st.one_of(PRINTABLE, st.lists(st.floats().map(repr), max_size=5).map(",".join)))
def test_scpi_numbers_are_numbers_or_an_error_that_names_the_instrument(answer: str) -> None:
    try:
        found = numbers(answer, "counter of input_torque")
    except BenchError as error:
        assert "counter of input_torque" in error.found  # noqa: PT017 - either is right
        return
    parts = [part.strip() for part in answer.split(",")] if answer else []
    assert len(found) == len(parts)
    for value, part in zip(found, parts, strict=True):
        assert NRF.fullmatch(part)
        assert math.isnan(value) or abs(value) < NO_NUMBER


@given(st.lists(st.floats(-1e30, 1e30), min_size=1, max_size=20))
def test_scpi_numbers_survive_their_way(values: list[float]) -> None:
    assert numbers(",".join(f"{value:.17E}" for value in values), "counter") == values


@contextmanager
def answering(answer: bytes) -> Iterator[str]:
    """Serve one answer to everything, and hang up."""
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve() -> None:
            while True:
                try:
                    connection, _ = server.accept()
                except OSError:
                    return
                with connection:
                    connection.recv(4096)
                    connection.sendall(answer)

        serving = threading.Thread(target=serve, daemon=True)
        serving.start()
        yield f"127.0.0.1:{server.getsockname()[1]}"
        server.shutdown(socket.SHUT_RDWR)
    serving.join()


@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.binary(max_size=80))
def test_whatever_bytes_a_scpi_instrument_sends(answer: bytes) -> None:
    with answering(answer) as address:
        link = ScpiLink("reference", address, timeout_s=2.0)
        try:
            identity = link.identity("reference")
        except BenchError as error:
            assert error.found  # noqa: PT017
        else:
            assert answer.partition(b"\n")[0].count(b",") == 3
            assert identity.details == {"address": address}
        finally:
            link.close()


def link_with(words: list[int]) -> Any:
    """Stand for a Modbus link that reads these registers; the map alone is under test."""

    def cut(_first: int, count: int) -> list[int]:
        return (words + [0] * count)[:count]

    return SimpleNamespace(name="drive", address="a:1", input_registers=cut)


@given(st.lists(WORD, min_size=14, max_size=14))
def test_whatever_a_modbus_drive_states_is_finite_or_an_error(words: list[int]) -> None:
    try:
        state = ModbusDrive(link_with(words), "output", 0.5).state()
    except BenchError as error:
        assert error.remedy  # noqa: PT017
        return
    for value in (state.torque_nm, state.speed_rad_s):
        assert value is None or math.isfinite(value)


@given(st.lists(WORD, min_size=4, max_size=4 + 2 * register_map.READOUT_SAMPLES))
def test_whatever_a_modbus_amplifier_states_has_a_time_for_each_sample(words: list[int]) -> None:
    readout = ModbusReadout(link_with(words))
    try:
        first, second = readout.read("input", 1.0, 1.0), readout.read("input", 1.05, 1.05)
    except BenchError as error:
        assert error.remedy  # noqa: PT017
        return
    for samples in (first, second):
        assert samples.time_s.shape == samples["signal"].shape
        assert np.isfinite(samples.time_s).all()


@given(st.lists(WORD, min_size=8, max_size=8))
def test_whatever_a_name_plate_holds_is_text(words: list[int]) -> None:
    assert isinstance(register_map.text_of(words), str)


@pytest.mark.parametrize("answer", ["1_000", "0x10", "１２", "1,,2", "1;2", " "])
def test_what_only_python_takes_for_a_number_is_none(answer: str) -> None:
    with pytest.raises(BenchError, match="numbers"):
        numbers(answer, "counter")
