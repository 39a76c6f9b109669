"""Reading back the record of a certificate, to compare it with the one that was written."""

import json
from dataclasses import MISSING, fields, is_dataclass
from datetime import date, datetime
from types import UnionType
from typing import Any, Union, cast, get_args, get_origin, get_type_hints

from torquebench.records.files import revived
from torquebench.reports.certificate import CertificateRecord
from torquebench.uncertainty import Verdict


def read_back(text: str) -> CertificateRecord:
    """Return the record that `CertificateRecord.to_json` wrote."""
    record = _restored(CertificateRecord, revived(json.loads(text)))
    assert isinstance(record, CertificateRecord)
    return record


def _restored(kind: Any, value: Any) -> Any:
    """Return a value of JSON as the type that a field asks for."""
    if is_dataclass(kind):
        hints = get_type_hints(kind)
        # A record of an older format lacks newer fields, which have defaults.
        names = [
            each.name
            for each in fields(kind)
            if each.name in value or each.default is each.default_factory is MISSING
        ]
        return cast(Any, kind)(**{name: _restored(hints[name], value[name]) for name in names})
    origin, inner = get_origin(kind), get_args(kind)
    if origin in (Union, UnionType):
        return None if value is None else _restored(inner[0], value)
    if origin is tuple:
        return tuple(
            _restored(inner[0] if inner[-1] is Ellipsis else inner[place], item)
            for place, item in enumerate(value)
        )
    if kind is datetime:
        return datetime.fromisoformat(value)
    if kind is date:
        return date.fromisoformat(value)
    if kind is Verdict:
        return Verdict(value)
    if kind is float:
        return float(value)
    return value
