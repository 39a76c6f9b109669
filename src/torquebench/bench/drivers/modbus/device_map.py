"""Maps of other makers' Modbus devices: addresses of values and contacts, and their coding.

A map is one of the files in `maps/`, by its name, or a table in the bench description:

```toml
[driver.temperature]
protocol = "modbus"
address = "192.168.0.31:502"
map = "moxa-e1260"                    # channels 0 to 5
probes = { ambient = 0, reducer = 3 }
```
"""

from __future__ import annotations

import struct
import tomllib
from collections.abc import Iterator, Sequence
from importlib.resources import files
from typing import Annotated, Literal

from pydantic import Field

from torquebench.bench.drivers.modbus.link import ModbusOptions
from torquebench.bench.drivers.plugins import Options
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.validation import validated

Register = Annotated[int, Field(ge=0, le=65535)]
WordOrder = Literal["high first", "low first"]
_FORMATS = {"int16": "h", "uint16": "H", "int32": "i", "uint32": "I", "float32": "f"}
_TO_CELSIUS = {"°C": (1.0, 0.0), "K": (1.0, -273.15), "°F": (5.0 / 9.0, -160.0 / 9.0)}


class ValueMap(Options):
    """Registers of values, one channel after the other.

    `value = offset + scale * number`, in `unit`. A number in the list `broken` means that the
    channel has no value. `plausible` is in °C.
    """

    function: Literal["input registers", "holding registers"] = "input registers"
    first: Register = 0
    stride: Annotated[int, Field(ge=1, le=125)] | None = None
    type: Literal["int16", "uint16", "int32", "uint32", "float32"] = "int16"
    word_order: WordOrder = "high first"
    scale: float = 1.0
    offset: float = 0.0
    unit: Literal["°C", "K", "°F"] = "°C"
    broken: tuple[float, ...] = ()
    plausible: tuple[float, float] = (5.0, 150.0)

    @property
    def width(self) -> int:
        """Registers of one value."""
        return struct.calcsize(f">{_FORMATS[self.type]}") // 2

    def register(self, channel: int) -> int:
        """Return the first register of a channel."""
        return self.first + channel * (self.stride or self.width)

    def number(self, words: Sequence[int]) -> float:
        """Decode the registers of one channel.

        Examples
        --------
        >>> ValueMap(type="float32", word_order="low first").number([0, 0x41BC])
        23.5
        """
        ordered = words if self.word_order == "high first" else words[::-1]
        raw = struct.pack(f">{len(ordered)}H", *ordered)
        return float(struct.unpack(f">{_FORMATS[self.type]}", raw)[0])

    def temperature_c(self, words: Sequence[int]) -> float:
        """Convert the registers of one channel, °C."""
        factor, zero = _TO_CELSIUS[self.unit]
        return (self.offset + self.scale * self.number(words)) * factor + zero

    def is_plausible(self, temperature_c: float) -> bool:
        """Return whether a temperature is within the plausible range; False for NaN."""
        low, high = self.plausible
        return low <= temperature_c <= high

    def readings_of_other_maps(self, words: Sequence[int]) -> Iterator[tuple[str, float]]:
        """Yield temperatures, °C, that the registers would mean if one property were wrong."""
        if self.width > 1:
            other: WordOrder = "low first" if self.word_order == "high first" else "high first"
            changed = self.model_copy(update={"word_order": other})
            yield f'word_order = "{other}"', changed.temperature_c(words)
        for factor in (0.01, 0.1, 10.0, 100.0):
            changed = self.model_copy(update={"scale": self.scale * factor})
            yield f"scale = {changed.scale:g}", changed.temperature_c(words)


class CoilMap(Options):
    """Coils: the address of channel 0."""

    first: Register = 0


class ContactMap(CoilMap):
    """Contacts: the address of channel 0, and the kind of input from which they are read."""

    function: Literal["discrete inputs", "coils"] = "discrete inputs"


class DeviceMap(Options):
    """Registers and bits of a device. Without `name_plate` it can't identify itself over Modbus."""

    manufacturer: str = ""
    model: str = ""
    name_plate: bool = False
    values: ValueMap = ValueMap()
    contacts: ContactMap = ContactMap()
    coils: CoilMap = CoilMap()


class MappedOptions(ModbusOptions):
    """Address of an instrument, its map, and its serial number if it can't report it."""

    map: str | DeviceMap = "torquebench"
    serial: str = ""


def maps() -> list[str]:
    """Return the names of the maps that come with the package."""
    folder = files("torquebench.bench.drivers.modbus") / "maps"
    return sorted(
        entry.name.removesuffix(".toml")
        for entry in folder.iterdir()
        if entry.name.endswith(".toml")
    )


def device_map(options: MappedOptions, section: str) -> DeviceMap:
    """Return the map that a section of a bench description names or contains.

    Raises
    ------
    InputError
        There is no map of this name.
    """
    if isinstance(options.map, DeviceMap):
        return options.map
    if options.map not in maps():
        raise InputError(
            Message("{section}.map = {map!r}", section, options.map),
            ", ".join(maps()),
            Message("or describe the device's registers in the table [{section}.map]", section),
        )
    path = files("torquebench.bench.drivers.modbus") / "maps" / f"{options.map}.toml"
    found: DeviceMap = validated(DeviceMap, tomllib.loads(path.read_text("utf-8")), options.map)
    return found
