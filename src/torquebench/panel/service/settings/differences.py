"""Flatten documents to keys and values, and find the differences between two of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Difference:
    """A key with different values; `before` or `after` is None if the key is missing."""

    key: str
    before: Any
    after: Any


def flat(document: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Flatten a nested document to values by dotted keys; lists count as values.

    Examples
    --------
    >>> flat({"input": {"limits": {"torque_nm": 60}}, "names": ["a"]})
    {'input.limits.torque_nm': 60, 'names': ['a']}
    """
    found: dict[str, Any] = {}
    for key, value in document.items():
        if isinstance(value, Mapping) and value:
            found |= flat(value, f"{prefix}{key}.")
        else:
            found[f"{prefix}{key}"] = value
    return found


def merged(base: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return a nested document with some of its values replaced or added.

    Examples
    --------
    >>> merged({"input": {"limits": {"torque_nm": 60, "speed_rpm": 9}}},
    ...        {"input": {"limits": {"torque_nm": 55}}})
    {'input': {'limits': {'torque_nm': 55, 'speed_rpm': 9}}}
    """
    found = dict(base)
    for key, value in changes.items():
        before = found.get(key)
        both = isinstance(before, Mapping) and isinstance(value, Mapping)
        found[key] = merged(before, value) if both else value  # type: ignore[arg-type]
    return found


def depth(value: Any) -> int:
    """Return the nesting depth of tables and lists.

    Examples
    --------
    >>> depth(1), depth({"a": [{"b": 1}]})
    (0, 3)
    """
    deepest, waiting = 0, [(value, 0)]
    while waiting:
        each, level = waiting.pop()
        deepest = max(deepest, level)
        parts = each.values() if isinstance(each, Mapping) else each
        if isinstance(each, Mapping | list):
            waiting += [(part, level + 1) for part in parts]
    return deepest


def nested(leaves: Mapping[str, Any]) -> dict[str, Any]:
    """Build a nested document from dotted keys, the inverse of `flat`.

    Examples
    --------
    >>> nested({"input.limits.torque_nm": 60})
    {'input': {'limits': {'torque_nm': 60}}}
    """
    document: dict[str, Any] = {}
    for key, value in leaves.items():
        *path, last = key.split(".")
        place = document
        for part in path:
            place = place.setdefault(part, {})
        place[last] = value
    return document


def differences(before: Mapping[str, Any], after: Mapping[str, Any]) -> tuple[Difference, ...]:
    """Return the differences between two nested documents, by key.

    Examples
    --------
    >>> differences({"a": {"b": 1, "c": 2}}, {"a": {"b": 1, "c": 3}})
    (Difference(key='a.c', before=2, after=3),)
    """
    old, new = flat(before), flat(after)
    return tuple(
        Difference(key, old.get(key), new.get(key))
        for key in sorted(old.keys() | new.keys())
        if old.get(key) != new.get(key)
    )
