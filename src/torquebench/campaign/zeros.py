"""The zeros that a run has read, entered for the control charts of their transducers."""

from __future__ import annotations

from datetime import UTC, datetime

from torquebench.bench.drivers.base import SIDES
from torquebench.records import RunFolder, Zeroing
from torquebench.station import RunRecord, Station

__all__ = ["register_zeroings"]


def register_zeroings(station: Station, record: RunRecord) -> None:
    """Register every zero among a run's documents, in one transaction.

    Parameters
    ----------
    station : Station
        The bench that the run belongs to.
    record : RunRecord
        Of the sealed run.
    """
    streams = {f"zero_{side}": side for side in SIDES}
    descriptors: dict[str, str] = {}
    found = []
    for name, document in RunFolder(record.folder).documents():
        if name == "descriptor" and document["name"] in streams:
            descriptors[document["uid"]] = document["name"]
        elif name == "event" and document["descriptor"] in descriptors:
            side = streams[descriptors[document["descriptor"]]]
            steady = station.devices.module(side).steady
            data = document["data"]
            transducer = station.description.module(side).transducer
            scale = transducer.scale()
            zero_hz = float(data[steady.key("frequency_hz")])
            sensitivity = transducer.nominal_sensitivity_hz_per_nm
            temperature = data.get(steady.key("temperature_c"))
            found.append(
                Zeroing(
                    transducer_serial=transducer.serial,
                    performed=datetime.fromtimestamp(document["time"], UTC),
                    zero_hz=zero_hz,
                    zero_nm=(zero_hz - scale.nominal_zero_hz) / sensitivity,
                    temperature_c=None if temperature is None else float(temperature),
                    run_id=record.run_id,
                    simulated=station.description.simulated,
                )
            )
    if found:
        with station.registry.writing():
            for zeroing in found:
                station.registry.add_zeroing(zeroing)
