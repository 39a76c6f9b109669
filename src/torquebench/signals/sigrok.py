"""Recordings of logic analysers in sigrok's session format."""

import configparser
import io
import re
import zipfile
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.signals.digital import edges_of_bytes
from torquebench.signals.edges import EdgeBlock

__all__ = ["LogicRecording", "parse_sigrok"]

_RATE_UNITS = {"": 1.0, "Hz": 1.0, "kHz": 1e3, "MHz": 1e6, "GHz": 1e9}


@dataclass(frozen=True, slots=True, eq=False)
class LogicRecording:
    """Samples of a logic analyser.

    Parameters
    ----------
    sample_rate_hz : float
        Samples per second.
    channels : tuple of str
        Names of the channels; channel k is bit k of a sample.
    samples : uint8 array, shape (n, m)
        n samples of m bytes, lowest channels in the first byte.
    """

    sample_rate_hz: float
    channels: tuple[str, ...]
    samples: NDArray[np.uint8]

    def edges(self, channel: int | str) -> EdgeBlock:
        """Rising and falling edges of one channel, by its name or its bit.

        Raises
        ------
        InputError
            When there is no such channel.
        """
        if isinstance(channel, str) and channel in self.channels:
            channel = self.channels.index(channel)
        if not isinstance(channel, int) or not 0 <= channel < 8 * self.samples.shape[1]:
            raise InputError(
                Message("channel {channel!r}", channel),
                Message("one of {list}", ", ".join(self.channels)),
            )
        column = np.ascontiguousarray(self.samples[:, channel // 8])
        return edges_of_bytes(column, self.sample_rate_hz, channel % 8)


def parse_sigrok(content: bytes) -> LogicRecording:
    """Read a sigrok session, format version 1 or 2, from the bytes of its file (.sr).

    The format is a zip archive with `metadata` (an INI file) and the samples in `logic-1` or
    `logic-1-1`, `logic-1-2` … (sigrok.org/wiki/File_format:Sigrok/v2).

    Parameters
    ----------
    content : bytes
        Content of the file.

    Raises
    ------
    InputError
        When it isn't such a file or lacks the samples or their rate.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            names = archive.namelist()
            metadata = archive.read("metadata").decode()
            device = _device(metadata)
            capture = device.get("capturefile", "logic-1")
            raw = b"".join(archive.read(name) for name in _captures(names, capture))
    except (zipfile.BadZipFile, KeyError, UnicodeDecodeError, configparser.Error) as error:
        raise InputError(
            Message("no sigrok session ({error})", error),
            "a zip archive with metadata and logic samples",
        ) from error
    width = int(device.get("unitsize", "1"))
    channels = _channels(device)
    if not raw or len(raw) % width:
        raise InputError(
            Message("{count} bytes of samples", len(raw)),
            Message("whole samples of {width} bytes", width),
        )
    samples = np.frombuffer(raw, dtype=np.uint8).reshape(-1, width)
    return LogicRecording(_rate(device.get("samplerate", "")), channels, samples)


def _device(metadata: str) -> dict[str, str]:
    parser = configparser.ConfigParser(interpolation=None)
    parser.read_string(metadata)
    return dict(parser["device 1"])


def _captures(names: list[str], capture: str) -> list[str]:
    """Members that hold the samples, in their order."""
    parts = []
    for name in names:
        match = re.fullmatch(re.escape(capture) + r"(?:-(\d+))?", name)
        if match:
            parts.append((int(match[1] or 0), name))
    return [name for _, name in sorted(parts)]


def _channels(device: dict[str, str]) -> tuple[str, ...]:
    count = int(device.get("total probes", "0"))
    return tuple(device.get(f"probe{number + 1}", f"D{number}") for number in range(count))


def _rate(text: str) -> float:
    match = re.fullmatch(r"([\d.]+)\s*(\w*)", text.strip())
    if match is None or match[2] not in _RATE_UNITS:
        raise InputError(Message("sample rate {text!r}", text), "a rate in Hz, kHz, MHz or GHz")
    return float(match[1]) * _RATE_UNITS[match[2]]
