"""Tables recorded as TDMS, as LabVIEW writes them; needs the extra `tdms`."""

from __future__ import annotations

import csv
import io
from pathlib import Path

from torquebench.errors import InputError

__all__ = ["tdms_as_csv"]


def tdms_as_csv(path: Path) -> str:
    """Return the first group of a TDMS file as CSV text, properties as comments before it.

    Channels are columns and must be of one length.

    Raises
    ------
    InputError
        npTDMS isn't installed, or the file holds no such group.
    """
    try:
        from nptdms import TdmsFile
    except ImportError as error:
        raise InputError(
            f"{path.name}: TDMS without npTDMS", "CSV", "pip install 'torquebench[tdms]'"
        ) from error
    try:
        file = TdmsFile.read(path)
    except Exception as error:  # the library raises what struct and its readers raise
        raise InputError(f"{path}: {error}", "a readable TDMS file") from error
    groups = [group for group in file.groups() if group.channels()]
    if not groups:
        raise InputError(f"{path}: no channels", "a group of channels of one length")
    channels = groups[0].channels()
    lengths = {channel.name: len(channel) for channel in channels}
    if len(set(lengths.values())) != 1:
        raise InputError(f"{path}: channels of {lengths} values", "channels of one length")
    text = io.StringIO()
    for properties in (file.properties, groups[0].properties):
        for name, value in properties.items():
            text.write(f"# {name} = {value}\n")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([channel.name for channel in channels])
    writer.writerows(zip(*(channel[:].tolist() for channel in channels), strict=True))
    return text.getvalue()
