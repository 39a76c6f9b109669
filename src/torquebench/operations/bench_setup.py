"""Write a new bench description by the bench's instruments, which a scan can search for."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from torquebench.bench.new_description import (
    FoundInstrument,
    NewBench,
    SideValues,
    description_text,
)
from torquebench.bench.roles import Signal
from torquebench.message import Message
from torquebench.operations.operation import WHOLE, Flag, Number, Operation, Request, field
from torquebench.operations.place import Place
from torquebench.operations.result import Result
from torquebench.progress import Progress
from torquebench.reports.page import Facts, Page, Section, Table

_ROLE_TITLES = {
    "nidaqmx": "NI-DAQmx card",
    "scpi": "SCPI",
    "opendaq": "openDAQ",
    "hbm": "HBM or HBK amplifier",
    "serial": "displays on serial lines",
    "opcua": "PLC by OPC UA",
    "ads": "Beckhoff PLC (ADS)",
    "s7": "Siemens S7",
    "canopen": "CANopen (CiA 402)",
    "ethercat": "EtherCAT (CiA 402)",
    "moteus": "moteus",
    "odrive": "ODrive (CAN)",
    "modbus": "Modbus",
    "counter": "at the counter",
    "drives": "the drives' own",
    "none": "none",
}


def _instrument(words: str, title: str) -> object:
    return field(words, title=title, titles=_ROLE_TITLES)


class NewDescription(Request):
    """Write a commented description of a new bench by its instruments.

    At a terminal the command asks for what isn't given. `doctor --bench FILE` then checks the file;
    serial numbers, channels, limits and the certificates' data have to be filled in before.

    A scan lists serial ports, VISA instruments, NI devices and the nodes of CAN buses, and tries
    the usual ports of the stated hosts (Modbus, SCPI, OPC UA, S7, ADS, HBM, NI gRPC). It asks SCPI,
    HBM, OPC UA and CANopen devices who they are, and sends nothing to others. EtherCAT drives are
    searched only behind the stated adapters, whose devices must not be in operation.
    """

    basic = ("out", "name", "counter", "signal", "drives", "reference")

    out: Annotated[
        Path, field("The file to write.", title="File", argument=True, output=(".toml",))
    ]
    name: Annotated[str, field("Name of the bench.", min_length=1, max_length=100)] = "New bench"
    counter: Annotated[
        Literal["nidaqmx", "scpi", "opendaq", "hbm", "serial", "opcua", "ads", "s7"],
        _instrument("What measures the torque of both modules.", "Torque of the modules"),
    ] = "nidaqmx"
    signal: Annotated[
        Signal, field("What the modules' transducers or their amplifier deliver.", title="Signal")
    ] = "frequency"
    drives: Annotated[
        Literal["canopen", "ethercat", "modbus", "ads", "s7", "moteus", "odrive"],
        _instrument("What the drives understand.", "Drives"),
    ] = "canopen"
    reference: Annotated[
        Literal["counter", "scpi", "modbus", "hbm", "serial", "opcua", "ads", "s7"],
        _instrument("Read-out of the calibrator's transducers.", "Calibrator"),
    ] = "counter"
    angles: Annotated[
        Literal["counter", "drives", "modbus", "ads", "s7", "none"],
        _instrument("Where the encoders are read; none for torque at rest only.", "Encoders"),
    ] = "drives"
    fixture: Annotated[
        Literal["modbus", "ads", "s7"],
        _instrument("Contacts of test-mode conversion and clamp.", "Clamp and test modes"),
    ] = "modbus"
    temperature: Annotated[
        Literal["modbus", "opcua", "ads", "s7"],
        _instrument("Temperature probes.", "Probes"),
    ] = "modbus"
    ratio: Annotated[Number, field("Ratio of the reducers to be tested.", gt=0, le=1e4)] = 80.0
    input_range_nm: Annotated[Number, field("Range of the input module.", gt=0, le=1e6)] = 50.0
    output_range_nm: Annotated[Number, field("Range of the output module.", gt=0, le=1e6)] = 2000.0
    input_speed_rpm: Annotated[
        Number, field("Largest speed of the input module.", gt=0, le=1e5)
    ] = 1300.0
    output_speed_rpm: Annotated[
        Number, field("Largest speed of the output module.", gt=0, le=1e5)
    ] = 20.0
    input_encoder_counts: Annotated[
        int, field("Counts of the input's encoder per turn of the shaft.", ge=4, le=2**31), WHOLE
    ] = 360000
    output_encoder_counts: Annotated[
        int, field("Counts of the output's encoder per turn of the shaft.", ge=4, le=2**31), WHOLE
    ] = 3600000
    output_gear_ratio: Annotated[
        Number, field("Turns of the output drive's motor per turn of the shaft.", gt=0, le=1e4)
    ] = 1.0
    scan: Annotated[
        Flag,
        field(
            "Search this computer, its CAN buses and the stated hosts for instruments.",
            role="administrator",
        ),
    ] = False
    hosts: Annotated[
        tuple[str, ...],
        field(
            "Host or network to search, such as 192.168.0.20 or 192.168.0.0/28.",
            title="Hosts",
            role="administrator",
            max_length=100,
        ),
    ] = ()
    can: Annotated[
        tuple[str, ...],
        field(
            "CAN bus to search, such as socketcan:can0.",
            title="CAN buses",
            role="administrator",
            max_length=20,
        ),
    ] = ()
    ethercat: Annotated[
        tuple[str, ...],
        field(
            "Network adapter behind which EtherCAT drives are searched, such as eth1.",
            title="EtherCAT adapters",
            role="administrator",
            max_length=4,
        ),
    ] = ()


@dataclass(frozen=True, kw_only=True)
class WrittenDescription(Result):
    """A new bench description, and the instruments that a scan found."""

    found: Sequence[FoundInstrument]

    def page(self) -> Page:
        """Return its description."""
        steps = [
            ("1", "replace serial numbers, channels, limits and the certificates' data"),
            ("2", Message("torquebench doctor --bench {file}", self.files[0])),
        ]
        sections = [Section("Next steps", "", [Facts(steps)])]
        if self.found:
            rows = [
                (
                    each.protocol,
                    each.address if each.node is None else f"{each.address}, node {each.node}",
                    each.identity or "–",
                    each.serial or "–",
                )
                for each in self.found
            ]
            columns = ("protocol", "address", "identity", "serial number")
            sections.insert(0, Section("Found instruments", "", [Table(columns, rows)]))
        return Page("New bench", "", sections)


def _described(request: NewDescription, found: tuple[FoundInstrument, ...] = ()) -> str:
    return description_text(
        NewBench(
            name=request.name,
            counter=request.counter,
            drives=request.drives,
            reference=request.reference,
            angles=request.angles,
            fixture=request.fixture,
            temperature=request.temperature,
            signal=request.signal,
            sides={
                "input": SideValues(
                    request.input_range_nm, request.input_speed_rpm, request.input_encoder_counts
                ),
                "output": SideValues(
                    request.output_range_nm,
                    request.output_speed_rpm,
                    request.output_encoder_counts,
                    request.output_gear_ratio,
                ),
            },
            ratio=request.ratio,
            found=found,
        )
    )


def _check(_place: Place, request: NewDescription) -> Iterable[str]:
    _described(request)
    return ()


def _run(_place: Place, request: NewDescription, progress: Progress) -> WrittenDescription:
    from torquebench.atomic_write import atomic_write
    from torquebench.bench.description import parse_bench
    from torquebench.bench.scanning import scan

    searched = (request.hosts, request.can, request.ethercat)
    found = scan(*searched, progress) if request.scan else ()
    text = _described(request, found)
    parse_bench(text, request.out.name)
    atomic_write(request.out, text)
    return WrittenDescription(
        headline=Message("{name} is described in {file}", request.name, request.out.name),
        found=found,
        files=(str(request.out),),
    )


NEW_BENCH = Operation(
    "bench new",
    NewDescription,
    _run,
    lambda request: Message("describe {name}", request.name),
    check=_check,
    where="files",
    asks=True,
)
