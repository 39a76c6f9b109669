"""Foreign Modbus devices through the map of a bench description, against peers of their manuals."""

from typing import Any

import pytest
from tests.peers.modbus_device import (
    READ_COILS,
    READ_DISCRETE,
    READ_HOLDING,
    READ_INPUT,
    ModbusDevicePeer,
    float_words,
)
from tests.system.networked import described

from torquebench.bench.drivers.instruments import open_role
from torquebench.bench.drivers.modbus.device_map import maps
from torquebench.errors import BenchError, InputError

PROBES = dict(zip(("ambient", "input_transducer", "output_transducer", "reducer", "calibrator"),
                  range(5), strict=True))  # fmt: skip
CELSIUS = (23.4, 24.0, 25.6, 31.2, 22.9)
EXPECTED = dict(zip(PROBES, CELSIUS, strict=True))


def temperature(peer: ModbusDevicePeer, **section: Any) -> Any:
    """Open the probes of a bench."""
    keys = {"protocol": "modbus", "address": peer.address, "interval_s": 0.0, "probes": PROBES}
    return open_role(described(temperature=keys | section), "temperature")


def e1260(*celsius: float) -> ModbusDevicePeer:
    """Six Pt100 in tenths of a degree, input registers 1536 to 1541; nothing else is there."""
    peer = ModbusDevicePeer()
    tenths = [round(10.0 * value) & 0xFFFF for value in (*celsius, 0.0)]
    peer.registers[READ_INPUT] = dict(zip(range(1536, 1542), tenths, strict=True))
    return peer


def test_a_pt100_module_by_its_name() -> None:
    with e1260(*CELSIUS) as peer:
        probes = temperature(peer, map="moxa-e1260", serial="TAIDB1234567")
        try:
            assert dict(probes.temperatures()) == pytest.approx(EXPECTED)
            assert peer.requests[-1] == (READ_INPUT, 1536, 5)
            identity = probes.identity()
        finally:
            probes.close()
    assert (identity.manufacturer, identity.model) == ("Moxa", "ioLogik E1260")
    assert identity.serial == "TAIDB1234567"


def test_a_probe_that_breaks_is_missing_and_never_an_old_value() -> None:
    with e1260(*CELSIUS) as peer:
        probes = temperature(peer, map="moxa-e1260")
        try:
            peer.registers[READ_INPUT][1536 + PROBES["reducer"]] = 8500
            assert set(probes.temperatures()) == set(PROBES) - {"reducer"}
        finally:
            probes.close()


FLOATS = {"function": "holding registers", "first": 100, "type": "float32"}


@pytest.mark.parametrize("low_first", [False, True])
@pytest.mark.parametrize(("unit", "shift"), [("°C", 0.0), ("K", 273.15)])
def test_floats_of_either_word_order_in_either_unit(
    low_first: bool, unit: str, shift: float
) -> None:
    device = FLOATS | {"unit": unit, "word_order": "low first" if low_first else "high first"}
    with ModbusDevicePeer(unit=17) as peer:
        for k, value in enumerate(CELSIUS):
            words = float_words(value + shift, low_first=low_first)
            peer.registers[READ_HOLDING] |= {100 + 2 * k: words[0], 101 + 2 * k: words[1]}
        probes = temperature(peer, map={"values": device}, unit=17)
        try:
            found = dict(probes.temperatures())
        finally:
            probes.close()
    assert found == pytest.approx(EXPECTED, abs=1e-3)


def test_a_wrong_scale_is_found_on_opening_and_named_where_nothing_else_explains_it() -> None:
    tenths = {"function": "input registers", "first": 1536, "type": "int16", "scale": 0.01}
    with (
        e1260(*CELSIUS) as peer,
        pytest.raises(BenchError, match=r"ambient reads 2\.34 °C \(registers 234\)") as error,
    ):
        temperature(peer, map={"values": tenths})
    assert "scale = 0.1 it reads 23.4 °C" in str(error.value.remedy)


def test_a_wrong_word_order_is_found_on_opening_and_named() -> None:
    with ModbusDevicePeer() as peer:
        for k, value in enumerate(CELSIUS):
            words = float_words(value, low_first=True)
            peer.registers[READ_HOLDING] |= {100 + 2 * k: words[0], 101 + 2 * k: words[1]}
        with pytest.raises(BenchError, match="ambient reads") as error:
            temperature(peer, map={"values": FLOATS})
    assert 'word_order = "low first" it reads 23.4 °C' in str(error.value.remedy)


def test_a_wrong_unit_identifier_is_refused_on_opening() -> None:
    with e1260(*CELSIUS) as peer, pytest.raises(BenchError, match="exception 11"):
        temperature(peer, map="moxa-e1260", unit=2)


def test_an_unknown_map_names_those_that_there_are() -> None:
    with (
        ModbusDevicePeer() as peer,
        pytest.raises(InputError, match=r"map = 'acme'.*moxa-e1260"),
    ):
        temperature(peer, map="acme")
    assert "torquebench" in maps()


@pytest.mark.parametrize(
    ("device", "function", "first_coil"),
    [("advantech-adam-6050", READ_COILS, 16), ("moxa-e1212", READ_DISCRETE, 0)],
)
def test_a_clamp_on_a_digital_module(device: str, function: int, first_coil: int) -> None:
    peer = ModbusDevicePeer()
    peer.bits[READ_COILS] = {first_coil + k: False for k in range(6)}
    contacts = {"clamp_closed": 0, "clamp_pressure": 3, "clamp_open": 1}
    peer.bits[function] |= dict.fromkeys(range(6), False)

    def follow() -> None:
        """Close the contacts of the clamp as its coil commands; the pressure switch opens."""
        closed = peer.bits[READ_COILS][first_coil + 2]
        peer.bits[function] |= {0: closed, 1: not closed, 3: not closed}

    peer.written = follow
    with peer:
        follow()
        section = {"protocol": "modbus", "address": peer.address, "map": device, "travel_s": 5.0}
        section |= {"coils": {"clamp": 2}, "contacts": contacts, "inverted": ["clamp_pressure"]}
        clamp = open_role(described(clamp=section), "clamp")
        try:
            assert not clamp.clamped()
            clamp.set_clamped(True)
            assert clamp.clamped()
            assert peer.bits[READ_COILS][first_coil + 2]
            clamp.set_clamped(False)
            assert not clamp.clamped()
        finally:
            clamp.close()
