"""Simulated instruments are as strict as real ones: asked over plain sockets, without drivers."""

import itertools
import math
import socket
import struct
import time
from collections.abc import Iterator
from typing import Any

import grpc
import numpy as np
import pytest
from nidaqmx._stubs import nidaqmx_pb2 as messages
from nidaqmx._stubs import nidaqmx_pb2_grpc as services
from tests.system.networked import daqmx, described

from torquebench.bench.drivers.instruments import open_role
from torquebench.simulators import Simulators
from torquebench.simulators import daqmx as daqmx_simulator

PATIENCE_S = 120.0
ENABLE, ZERO, RESET = 1, 2, 0x80
ENABLED, FAULT, RAMPING, TRIPPED = 1, 2, 4, 8
CONTROL, TORQUE, RATE, WATCHDOG, WATCHDOG_TIME = 0, 2, 4, 12, 13


@pytest.fixture(scope="module")
def simulators() -> Iterator[Simulators]:
    with Simulators(described()) as running:
        running.plant.reading(True)  # as if a counter was read: time goes on by `go_on` alone
        yield running


@pytest.fixture(autouse=True)
def healed(simulators: Simulators) -> Iterator[None]:
    yield
    simulators.misbehaviour.heal()
    for drive in simulators.plant.bench.drives.values():
        drive.disable()
        drive.reset_fault()


def go_on(simulators: Simulators, duration_s: float) -> None:
    assert simulators.plant.require(simulators.plant.now_s + duration_s, PATIENCE_S)


# -- Modbus -----------------------------------------------------------------------------------


class ModbusClient:
    """Requests as bytes."""

    def __init__(self, address: str) -> None:
        host, _, port = address.rpartition(":")
        self.socket = socket.create_connection((host, int(port)), PATIENCE_S)

    def send(self, pdu: bytes, transaction: int = 1, unit: int = 1) -> None:
        self.socket.sendall(struct.pack(">HHHB", transaction, 0, len(pdu) + 1, unit) + pdu)

    def receive(self) -> tuple[int, bytes]:
        header = self._exactly(7)
        transaction, _, length, _ = struct.unpack(">HHHB", header)
        return transaction, self._exactly(length - 1)

    def _exactly(self, count: int) -> bytes:
        data = b""
        while len(data) < count:
            part = self.socket.recv(count - len(data))
            assert part, "closed"
            data += part
        return data

    def ask(self, pdu: bytes, unit: int = 1) -> bytes:
        self.send(pdu, unit=unit)
        return self.receive()[1]

    def read(self, function: int, first: int, count: int) -> list[int]:
        answer = self.ask(struct.pack(">BHH", function, first, count))
        assert answer[:2] == bytes([function, 2 * count]), answer
        return list(struct.unpack(f">{count}H", answer[2:]))

    def write(self, first: int, values: list[int]) -> int:
        """Write registers and return the exception code, 0 where there was none."""
        count = len(values)
        head = struct.pack(">BHHB", 16, first, count, 2 * count)
        answer = self.ask(head + struct.pack(f">{count}H", *values))
        return answer[1] if answer[0] == 0x90 else 0

    @property
    def status(self) -> int:
        return self.read(4, 0, 1)[0]


def words(value: float) -> list[int]:
    return list(struct.unpack(">2H", struct.pack(">f", value)))


@pytest.fixture
def drive(simulators: Simulators) -> Iterator[ModbusClient]:
    client = ModbusClient(simulators.description.driver["input_drive"]["address"])
    assert client.write(CONTROL, [RESET, 0]) == 0
    assert client.write(WATCHDOG, [1, 500]) == 0
    assert client.write(CONTROL, [ENABLE, 0]) == 0
    yield client
    client.write(CONTROL, [0, 0])
    client.socket.close()


def test_requests_may_come_before_others_are_answered(drive: ModbusClient) -> None:
    requests = b""
    for number in range(20):
        pdu = struct.pack(">BHH", 4, number % 10, 1)
        requests += struct.pack(">HHHB", number, 0, len(pdu) + 1, 1) + pdu
    drive.socket.sendall(requests[:25])
    time.sleep(0.02)  # the rest comes in pieces that end in the middle of a request
    drive.socket.sendall(requests[25:])
    assert [drive.receive()[0] for _ in range(20)] == list(range(20))


@pytest.mark.parametrize(
    ("pdu", "code"),
    [
        (bytes([43, 14, 1, 0]), 1),
        (bytes([7]), 1),
        (struct.pack(">BHH", 4, 14, 1), 2),
        (struct.pack(">BHH", 4, 0, 15), 2),
        (struct.pack(">BHH", 3, 14, 1), 2),
        (struct.pack(">BHH", 1, 0, 1), 2),
        (struct.pack(">BHH", 6, 14, 0), 2),
        (struct.pack(">BHH", 4, 0, 0), 3),
        (struct.pack(">BHH", 4, 0, 126), 3),
        (struct.pack(">BHHBH", 16, 0, 1, 4, 0), 3),
        (struct.pack(">BH", 4, 0), 3),
    ],
)
def test_what_it_does_not_know_has_its_exception_code(
    drive: ModbusClient, pdu: bytes, code: int
) -> None:
    assert drive.ask(pdu) == bytes([pdu[0] | 0x80, code])


def test_a_unit_that_is_not_there_is_a_gateway_s_exception(drive: ModbusClient) -> None:
    assert drive.ask(struct.pack(">BHH", 4, 0, 1), unit=9) == bytes([0x84, 11])
    assert drive.ask(struct.pack(">BHH", 4, 0, 1), unit=255)[0] == 4


@pytest.mark.parametrize(
    ("place", "values"),
    [
        (TORQUE, words(math.nan)),
        (TORQUE, words(math.inf)),
        (TORQUE, words(1e6)),
        (RATE, words(0.0)),
        (RATE, words(-5.0)),
        (RATE, words(math.nan)),
        (10, words(-1.0)),
        (TORQUE, words(1.0)[:1]),
        (CONTROL, [0x10]),
        (1, [3]),
    ],
)
def test_nonsense_is_refused_and_changes_nothing(
    drive: ModbusClient, place: int, values: list[int]
) -> None:
    before = drive.read(3, 0, 14)
    assert drive.write(place, values) == 3
    assert drive.read(3, 0, 14) == before


def test_the_watchdog_acts_after_the_time_that_was_written(
    drive: ModbusClient, simulators: Simulators
) -> None:
    assert drive.read(3, WATCHDOG_TIME, 1) == [500]
    drive.write(WATCHDOG, [2, 200])
    assert drive.read(3, WATCHDOG_TIME, 1) == [200]
    go_on(simulators, 0.15)
    assert drive.status & ENABLED
    go_on(simulators, 0.1)
    assert drive.status & (ENABLED | FAULT | TRIPPED) == FAULT | TRIPPED
    drive.write(CONTROL, [ENABLE, 0])
    assert not drive.status & ENABLED, "a fault is reset before"
    drive.write(WATCHDOG, [3, 0])
    drive.write(CONTROL, [RESET, 0])
    drive.write(CONTROL, [ENABLE, 0])
    go_on(simulators, 2.0)
    assert drive.status & ENABLED, "0 switches it off"


def test_ramping_is_said_while_it_ramps(drive: ModbusClient, simulators: Simulators) -> None:
    assert not drive.status & RAMPING
    drive.write(TORQUE, [*words(10.0), *words(50.0)])
    drive.write(CONTROL, [ENABLE, 1])
    go_on(simulators, 0.1)
    assert drive.status & RAMPING
    go_on(simulators, 0.2)
    assert not drive.status & RAMPING


def test_it_acknowledges_and_does_nothing(drive: ModbusClient, simulators: Simulators) -> None:
    drive.write(TORQUE, [*words(10.0), *words(500.0)])
    drive.write(CONTROL, [ENABLE, 1])
    go_on(simulators, 0.1)
    simulators.misbehaviour.start("input_drive", "ignore")
    simulators.misbehaviour.start("input_drive", "unguarded")
    assert drive.write(CONTROL, [0, 0]) == 0
    go_on(simulators, 2.0)
    assert drive.status & ENABLED
    assert simulators.plant.bench.drives["input"].state().torque_nm == 10.0


def test_a_drive_with_a_wrong_scale_does_more_than_it_says(
    drive: ModbusClient, simulators: Simulators
) -> None:
    simulators.misbehaviour.start("input_drive", "scale", amount=1.1)
    drive.write(TORQUE, [*words(10.0), *words(500.0)])
    drive.write(CONTROL, [ENABLE, 1])
    go_on(simulators, 0.1)
    assert drive.read(4, 3, 2) == words(10.0)
    assert simulators.plant.bench.drives["input"].state().torque_nm == pytest.approx(11.0)


def test_each_answer_takes_its_time(drive: ModbusClient, simulators: Simulators) -> None:
    def asking_s() -> float:
        started = time.monotonic()
        for _ in range(10):
            drive.read(4, 0, 14)
        return time.monotonic() - started

    simulators.misbehaviour.start("input_drive", "delay", amount=0.05)
    assert asking_s() >= 0.5


# -- SCPI -------------------------------------------------------------------------------------


class ScpiClient:
    """Lines."""

    def __init__(self, address: str) -> None:
        host, _, port = address.rpartition(":")
        self.socket = socket.create_connection((host, int(port)), PATIENCE_S)
        self.lines = self.socket.makefile("rb")

    def ask(self, line: str) -> str:
        self.tell(line)
        return self.lines.readline().decode().rstrip("\n")

    def tell(self, line: str) -> None:
        self.socket.sendall(line.encode() + b"\r\n")

    def close(self) -> None:
        self.lines.close()
        self.socket.close()


@pytest.fixture
def counter(simulators: Simulators) -> Iterator[ScpiClient]:
    client = ScpiClient(simulators.description.driver["counter"]["channels"]["input_torque"])
    client.tell("*RST;*CLS;*ESE 0")
    yield client
    client.tell("ABOR")
    client.close()


def test_common_commands_are_those_of_ieee_488_2(counter: ScpiClient) -> None:
    assert counter.ask("*OPC?") == "1"
    assert counter.ask("*ESR?;*STB?") == "0;0"
    counter.tell("*OPC")
    assert counter.ask("*ESR?") == "1"
    counter.tell("NONSENSE")
    assert counter.ask("*STB?") == "4", "the error queue holds something"
    counter.tell("*ESE 32")
    assert counter.ask("*STB?") == str(4 + 32)
    assert counter.ask("*ESR?") == "32", "a command error"
    assert counter.ask("*ESR?") == "0", "read, so cleared"
    counter.tell("SENS:FREQ:GATE:TIME 1e9;*ESE 0")
    counter.tell("*CLS")
    assert counter.ask("SYST:ERR?;*ESR?;*STB?") == '0,"No error";0;0'


def test_headers_have_a_long_form_and_share_a_path(counter: ScpiClient) -> None:
    counter.tell("SENSe:FREQuency:GATE:TIME 20MS;SOURCE TIME;:samp:coun 5")
    assert counter.ask("SYSTEM:ERROR:NEXT?") == '0,"No error"'
    assert float(counter.ask("freq:gate:time?")) == 0.02
    assert counter.ask("SAMPLE:COUNT?;:SENS:ROSC:SOUR?") == "5;INT"
    counter.tell("ROSC:SOUR EXTERNAL")
    assert counter.ask("SENSE:ROSCILLATOR:SOURCE?") == "EXT"


@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("SENS:FREQ:GATE:TIME NAN", -104),
        ("SENS:FREQ:GATE:TIME INF", -104),
        ("SENS:FREQ:GATE:TIME -1", -222),
        ("SENS:FREQ:GATE:TIME 1E9", -222),
        ("SENS:FREQ:GATE:TIME", -109),
        ("ABOR 1", -108),
        ("SENS:FREQ:MODE SLOW", -224),
        ("SENSI:FREQ:MODE CONT", -113),
        ("DATA:REM? 5,WAIT", -230),
        ("INIT;INIT", -213),
    ],
)
def test_each_error_has_its_number(counter: ScpiClient, line: str, code: int) -> None:
    counter.tell(line)
    assert counter.ask("SYST:ERR?").startswith(f"{code},")
    assert counter.ask("SYST:ERR:COUN?") == "0"


def test_the_error_queue_overflows(counter: ScpiClient) -> None:
    for _ in range(30):
        counter.tell("NONSENSE")
    said = [counter.ask("SYST:ERR?") for _ in range(21)]
    assert said[0].startswith("-113")
    assert said[19] == '-350,"Queue overflow"'
    assert said[20] == '0,"No error"'


def test_a_read_out_with_jitter_hands_out_every_sample_once(simulators: Simulators) -> None:
    simulators.plant.bench.mount("calibrator")
    amplifier = ScpiClient(simulators.description.driver["reference"]["address"])
    try:
        amplifier.ask("FETC:ARR? (@2)")
        simulators.misbehaviour.start("reference", "jitter", amount=0.1)
        counts = []
        for _ in range(20):
            go_on(simulators, 0.05)
            answer = amplifier.ask("FETCH:ARRAY? (@2)")
            counts.append(len(answer.split(",")) if answer else 0)
        simulators.misbehaviour.heal()
        counts.append(len(amplifier.ask("FETC:ARR? (@2)").split(",")))
        assert len(set(counts)) > 3, "not the same number each time"
        assert abs(sum(counts) - 100) <= 1
    finally:
        amplifier.close()
        simulators.plant.bench.mount("nothing")


def test_a_counter_with_jitter_answers_late_on_the_bench(
    counter: ScpiClient, simulators: Simulators
) -> None:
    counter.tell("SENS:FREQ:GATE:TIME 0.01;:INIT")
    counter.ask("DATA:REM? 1,WAIT")
    begun_s = simulators.plant.now_s - 0.01
    simulators.misbehaviour.start("counter", "jitter", amount=0.2)
    late = []
    for number in range(2, 8):
        assert len(counter.ask("DATA:REM? 1,WAIT").split(",")) == 1
        late.append(simulators.plant.now_s - begun_s - 0.01 * number)
    assert min(late) >= -1e-6
    assert 0.02 < max(late) <= 0.2


def test_a_wrong_scale_is_in_every_reading_from_then_on(
    counter: ScpiClient, simulators: Simulators
) -> None:
    counter.tell("SENS:FREQ:GATE:TIME 0.01;:INIT")
    before = float(counter.ask("DATA:REM? 1,WAIT"))
    simulators.misbehaviour.start("counter", "scale", amount=1.5)
    assert float(counter.ask("DATA:REM? 1,WAIT")) == pytest.approx(1.5 * before, rel=1e-3)
    probes = ModbusClient(simulators.description.driver["temperature"]["address"])
    try:
        warm = probes.read(4, 0, 5)
        simulators.misbehaviour.start("temperature", "scale", amount=2.0)
        assert probes.read(4, 0, 5) == pytest.approx([2 * word for word in warm], abs=2)
    finally:
        probes.socket.close()


def test_positions_with_jitter_are_those_of_some_time_ago(
    drive: ModbusClient, simulators: Simulators
) -> None:
    angles = ModbusClient(simulators.description.driver["angles"]["address"])
    try:
        simulators.plant.bench.set_mode("input", "driven")
        drive.write(WATCHDOG, [4, 0])
        drive.write(6, [*words(10.0), *words(1000.0)])
        drive.write(CONTROL, [ENABLE, 2])
        go_on(simulators, 0.5)
        before = [angles.read(4, 0, 2) for _ in range(5)]
        assert before == sorted(before)
        simulators.misbehaviour.start("angles", "jitter", amount=0.3)
        after = [angles.read(4, 0, 2) for _ in range(10)]
        assert after != sorted(after), "some are older than the one before"
    finally:
        drive.write(CONTROL, [0, 0])
        simulators.plant.bench.set_mode("input", "free")
        angles.socket.close()


# -- CANopen ----------------------------------------------------------------------------------


class CanClient:
    """Frames over socketcand's protocol."""

    def __init__(self, address: str, port: int) -> None:
        self.socket = socket.create_connection((address, port), PATIENCE_S)
        self.rest = b""
        for request in (b"", b"< open can0 >", b"< rawmode >"):
            self.socket.sendall(request)
            self._line()

    def _line(self) -> bytes:
        while b">" not in self.rest:
            data = self.socket.recv(4096)
            assert data, "closed"
            self.rest += data
        line, _, self.rest = self.rest.partition(b">")
        return line

    def send(self, can_id: int, data: bytes) -> None:
        words = data.hex(" ")
        self.socket.sendall(f"< send {can_id:03X} {len(data)} {words} >".encode())

    def wait_for(self, can_id: int) -> bytes:
        while True:
            found = self._line().split()
            if found[1] == b"frame" and int(found[2], 16) == can_id:
                return bytes.fromhex(b"".join(found[4:]).decode())

    def sdo(self, request: bytes) -> bytes:
        self.send(0x605, request.ljust(8, b"\0"))
        return self.wait_for(0x585)

    def write(self, index: int, value: int, size: int, subindex: int = 0) -> int:
        """Write an object and return the abort code, 0 where there was none."""
        head = struct.pack("<BHB", 0x23 | (4 - size) << 2, index, subindex)
        answer = self.sdo(head + value.to_bytes(size, "little", signed=value < 0))
        return 0 if answer[0] == 0x60 else int(struct.unpack("<I", answer[4:])[0])

    def read(self, index: int, subindex: int = 0) -> int:
        answer = self.sdo(struct.pack("<BHB", 0x40, index, subindex))
        assert answer[0] & 0xE2 == 0x42, answer.hex()
        return int.from_bytes(answer[4 : 8 - (answer[0] >> 2 & 3)], "little")

    def enable(self) -> None:
        for word in (0x80, 0x06, 0x07, 0x0F):
            assert self.write(0x6040, word, 2) == 0
        assert self.read(0x6041) & 0x6F == 0x27


@pytest.fixture
def node(simulators: Simulators) -> Iterator[CanClient]:
    bus = simulators.description.driver["output_drive"]["bus"]
    client = CanClient(bus["host"], bus["port"])
    client.send(0x000, bytes([129, 5]))
    assert client.wait_for(0x705) == b"\0", "boot-up"
    client.send(0x000, bytes([1, 5]))
    yield client
    simulators.misbehaviour.heal()
    client.send(0x000, bytes([129, 5]))
    client.wait_for(0x705)
    client.socket.close()


def test_a_node_produces_its_heartbeat(node: CanClient) -> None:
    assert node.write(0x1017, 20, 2) == 0
    assert [node.wait_for(0x705) for _ in range(3)] == [b"\5"] * 3
    node.send(0x000, bytes([128, 5]))
    while node.wait_for(0x705) != b"\x7f":
        pass


def test_a_stopped_node_answers_no_question(node: CanClient) -> None:
    node.write(0x1017, 20, 2)
    node.send(0x000, bytes([2, 5]))
    while node.wait_for(0x705) != b"\4":
        pass
    node.send(0x605, struct.pack("<BHBI", 0x40, 0x6041, 0, 0))
    node.send(0x000, bytes([1, 5]))
    while node.wait_for(0x705) != b"\5":
        pass
    assert node.read(0x6041), "it answers again"


def test_a_missing_heartbeat_is_a_fault_with_an_emergency(
    node: CanClient, simulators: Simulators
) -> None:
    assert node.write(0x1016, 126 << 16 | 200, 4, 1) == 0
    assert node.read(0x1016, 1) == 126 << 16 | 200
    node.enable()
    go_on(simulators, 1.0)
    assert node.read(0x6041) & 0x6F == 0x27, "watched from the first heartbeat on"
    node.send(0x77E, b"\5")
    assert node.read(0x6041) & 0x6F == 0x27
    go_on(simulators, 0.15)
    assert node.read(0x6041) & 0x6F == 0x27
    go_on(simulators, 0.1)
    assert struct.unpack("<HB", node.wait_for(0x085)[:3]) == (0x8130, 0x11)
    assert node.read(0x6041) & 0x4F == 0x08
    assert (node.read(0x603F), node.read(0x1001)) == (0x8130, 0x11)
    node.write(0x6040, 0x80, 2)
    assert node.wait_for(0x085)[:2] == b"\0\0"


def test_a_fault_is_reset_by_a_rising_edge_only(node: CanClient, simulators: Simulators) -> None:
    node.enable()
    node.write(0x6040, 0x8F, 2)
    node.send(0x000, bytes([2, 5]))
    node.send(0x000, bytes([1, 5]))
    assert node.read(0x6041) & 0x4F == 0x08, "stopping the node took its power"
    assert not simulators.plant.bench.drives["output"].state().enabled
    node.write(0x6040, 0x80, 2)
    assert node.read(0x6041) & 0x4F == 0x08, "bit 7 was set before"
    node.write(0x6040, 0x00, 2)
    node.write(0x6040, 0x80, 2)
    assert node.read(0x6041) & 0x4F == 0x40


def test_a_mode_goes_to_the_target_that_is_there(node: CanClient, simulators: Simulators) -> None:
    node.write(0x6060, 4, 1)
    node.enable()
    node.write(0x6087, 100_000, 4)
    assert node.write(0x6071, 500, 2) == 0
    assert not node.read(0x6041) & 0x400, "it is on its way"
    go_on(simulators, 0.1)
    assert node.read(0x6041) & 0x400, "target reached"
    assert node.read(0x6077) == 500
    node.write(0x6060, 3, 1)
    node.write(0x6071, 250, 2)
    go_on(simulators, 0.1)
    assert node.read(0x6077) == 500
    node.write(0x6060, 4, 1)
    go_on(simulators, 0.1)
    assert node.read(0x6077) == 250


@pytest.mark.parametrize(
    ("index", "value", "size", "code"),
    [
        (0x6060, 9, 1, 0x06090030),
        (0x6071, 32767, 2, 0x06090031),
        (0x6071, -32768, 2, 0x06090032),
        (0x60FF, 2**31 - 1, 4, 0x06090031),
        (0x6087, 0, 4, 0x06090032),
        (0x6007, 7, 2, 0x06090031),
        (0x6041, 0, 2, 0x06010002),
        (0x2000, 0, 2, 0x06020000),
        (0x6071, 0, 4, 0x06070010),
    ],
)
def test_nonsense_is_aborted_with_its_code(
    node: CanClient, index: int, value: int, size: int, code: int
) -> None:
    assert node.write(index, value, size) == code


def test_a_drive_on_can_acknowledges_and_stays_on(node: CanClient, simulators: Simulators) -> None:
    node.write(0x6060, 4, 1)
    node.enable()
    simulators.misbehaviour.start("output_drive", "ignore")
    assert node.write(0x6040, 0, 2) == 0
    assert node.read(0x6041) & 0x6F == 0x27
    assert simulators.plant.bench.drives["output"].state().enabled


# -- NI-DAQmx ---------------------------------------------------------------------------------


class CounterClient:
    """Calls of the gRPC Device Server, without NI's library above them."""

    def __init__(self, address: str) -> None:
        own = [("grpc.use_local_subchannel_pool", 1)]  # else clients of one process share one
        self.channel = grpc.insecure_channel(address, own)
        self.stub = services.NiDAQmxStub(self.channel)

    def call(self, name: str, task: str, **fields: Any) -> Any:
        request = getattr(messages, f"{name}Request")(task={"name": task}, **fields)
        return getattr(self.stub, name)(request, timeout=PATIENCE_S)

    def encoder(self, name: str, counter: str, buffer: int = 1000) -> None:
        self.stub.CreateTask(messages.CreateTaskRequest(session_name=name))
        self.call("CreateCIAngEncoderChan", name, counter=counter)
        self.call("CfgSampClkTiming", name, rate=1000.0, samps_per_chan=buffer)
        self.call("StartTask", name)

    def clock(self) -> None:
        self.stub.CreateTask(messages.CreateTaskRequest(session_name="clock"))
        self.call("CreateCOPulseChanFreq", "clock", counter="Dev1/ctr4", freq=1000.0)
        self.call("StartTask", "clock")

    def read(self, name: str, count: int, timeout: float) -> Any:
        return self.call("ReadCounterU32Ex", name, num_samps_per_chan=count, timeout=timeout)

    def close(self) -> None:
        self.channel.close()


def failure(call: Any) -> int:
    """Return the driver's error by which a call ends."""
    with pytest.raises(grpc.RpcError) as caught:
        call()
    return int(dict(caught.value.trailing_metadata())["ni-error"])


@pytest.fixture(params=["on-demand", "real"])
def card(request: pytest.FixtureRequest) -> Iterator[Simulators]:
    simulation = {"control": "127.0.0.1:0", "time": request.param}
    with Simulators(described(counter=daqmx(), simulation=simulation)) as running:
        yield running


def test_counters_wait_overrun_and_are_reserved(card: Simulators) -> None:
    client = CounterClient(card.description.driver["counter"]["address"])
    try:
        client.encoder("one", "Dev1/ctr2", buffer=3000)  # a busy computer may be late by seconds
        client.stub.CreateTask(messages.CreateTaskRequest(session_name="other"))
        client.call("CreateCIAngEncoderChan", "other", counter="Dev1/ctr2")
        assert failure(lambda: client.call("StartTask", "other")) == -50103
        wrong = {"counter": "Dev1/ctr9"}
        assert failure(lambda: client.call("CreateCIPeriodChan", "other", **wrong)) == -200170
        assert failure(lambda: client.call("StartTask", "nobody")) == -200088
        assert client.read("one", 5, 0.05).status == -200284, "nothing has armed it"
        begun_s = card.plant.now_s
        client.clock()
        assert client.read("one", 50, 1.0).samps_per_chan_read == 50
        assert card.plant.now_s - begun_s >= 0.049, "it waited on the bench"
        assert client.read("one", 3000, 0.01).status == -200284, "no longer than it may"
        assert card.plant.require(card.plant.now_s + 3.2, PATIENCE_S)
        assert failure(lambda: client.read("one", 10, 0.1)) == -200279
    finally:
        client.close()


def test_the_tasks_of_a_client_that_has_gone_are_cleared(card: Simulators) -> None:
    address = card.description.driver["counter"]["address"]
    first, second = CounterClient(address), CounterClient(address)
    try:
        first.encoder("first", "Dev1/ctr2")
        second.stub.CreateTask(messages.CreateTaskRequest(session_name="second"))
        second.call("CreateCIAngEncoderChan", "second", counter="Dev1/ctr2")
        assert failure(lambda: second.call("StartTask", "second")) == -50103
        first.close()
        deadline = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline:
            try:
                second.call("StartTask", "second")
                break
            except grpc.RpcError:
                time.sleep(0.02)
        assert failure(lambda: second.call("StartTask", "first")) == -200088
        second.call("StopTask", "second")
    finally:
        first.close()
        second.close()


def test_what_came_late_from_the_card_is_read_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    reads = []
    read = daqmx_simulator._Servicer.ReadCounterU32Ex

    def counted(self: Any, request: Any, context: Any) -> Any:
        reads.append(request.num_samps_per_chan)
        return read(self, request, context)

    monkeypatch.setattr(daqmx_simulator._Servicer, "ReadCounterU32Ex", counted)
    with Simulators(described(counter=daqmx())) as running:
        counter = open_role(running.description, "counter")
        try:
            counter.select(frozenset({"output_torque"}))
            blocks = [counter.read_block(0.05)]
            assert running.plant.require(running.plant.now_s + 3.0, PATIENCE_S)
            blocks += [counter.read_block(0.05) for _ in range(2)]
            reads.clear()
            blocks += [counter.read_block(0.05) for _ in range(57)]
            behind = len(reads)
            for _ in range(3):
                blocks.append(counter.read_block(0.05))
        finally:
            counter.close()
    assert behind == 0, "they were read when the computer was seen to be behind"
    assert 2.0 < float(blocks[2].waiting_s or 0.0) < 3.1, "what was read early is still ahead"
    assert float(blocks[-1].waiting_s or 0.0) < 0.1
    for before, after in itertools.pairwise(blocks):
        assert after.start_s == before.stop_s
        assert after.edges["output_torque"].ticks.size > 0
        gap = after.edges["output_torque"].ticks[0] - before.edges["output_torque"].ticks[-1]
        assert gap < 2 * np.median(np.diff(after.edges["output_torque"].ticks))
        assert len(after.records["output_angle"]) == 50
