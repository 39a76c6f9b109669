"""Kinds of equipment in a registry, for requests that don't need the registry itself."""

from typing import Literal

EquipmentKind = Literal[
    "transducer",
    "calibrator",
    "verification-standard",
    "counter",
    "drive",
    "encoder",
    "bench",
    "reducer",
]
