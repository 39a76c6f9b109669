"""Digital calibration certificates (PTB's DCC) of any institute: their statements about a torque.

They are read without a schema, so that all versions from 2.4 to 3.3 and small formal defects are
accepted; `certificate --check` validates them.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.tables.units import unit_named
from torquebench.uncertainty import CertifiedUncertainty

FloatArray = NDArray[np.float64]
Element = ElementTree.Element
NAMESPACE = b"https://ptb.de/dcc"
MOST_BYTES = 16 << 20
_NOMINAL_FACTOR = 2.0
_PREFIXES = {"kilo": 1e3, "mega": 1e6, "milli": 1e-3, "micro": 1e-6, "centi": 1e-2, "deca": 1e1}
_UNCERTAINTY = re.compile(
    r"uncertainty|unsicherheit|incertitude|incertidumbre|不确定度|不確かさ", re.I
)
_REFERENCE = re.compile(
    r"reference|applied|nominal|calibrationvalue|bezug|sollwert|normal|标准|référence", re.I
)


@dataclass(frozen=True, eq=False)
class DccQuantity:
    r"""A quantity of a result.

    Parameters
    ----------
    name : str
        Name, in English if the certificate has it.
    kinds : tuple of str
        Its reference types, such as "basic_measuredValue".
    unit : str
        Unit in the certificate, such as ``\newton\metre``.
    values : array of float, shape (n,)
    expanded : array of float, shape (n,), or None
        Expanded uncertainty for k = 2, in the unit.
    relative : bool
        Whether `expanded` is a share of the value.
    """

    name: str
    kinds: tuple[str, ...]
    unit: str
    values: FloatArray
    expanded: FloatArray | None = None
    relative: bool = False

    @property
    def nm(self) -> float | None:
        """N·m per unit of the quantity; None for other kinds of units."""
        return _newton_metres(self.unit)

    def shown(self) -> list[str]:
        """Return the values with U, as texts."""
        if self.expanded is None or self.expanded.shape != self.values.shape:
            return [f"{value:.10g}" for value in self.values.tolist()]
        expanded = self.expanded * (np.abs(self.values) if self.relative else 1.0)
        pairs = zip(self.values.tolist(), expanded.tolist(), strict=True)
        return [f"{value:.10g} ± {u:.2g}" for value, u in pairs]

    @property
    def is_reference(self) -> bool:
        """Whether the quantity is the one with which the item was compared."""
        return any(_REFERENCE.search(text) for text in (*self.kinds, self.name))


@dataclass(frozen=True, eq=False)
class DigitalCertificate:
    """A digital calibration certificate.

    Parameters
    ----------
    version : str
        Version of the schema that the certificate states.
    number, laboratory, country : str
    item, serial : str
        Name and identification of the calibrated item.
    performed, issued : str
        Days as the certificate writes them.
    signed : bool
        Whether the certificate has a signature, which isn't checked here.
    results : tuple of (str, tuple of DccQuantity)
        Tables of results by their titles.
    """

    version: str
    number: str
    laboratory: str
    country: str
    item: str
    serial: str
    performed: str
    issued: str
    signed: bool
    results: tuple[tuple[str, tuple[DccQuantity, ...]], ...]

    @property
    def record(self) -> str:
        """Description of the certificate, for a record of the standard's uncertainty."""
        item = f" of {self.item}" if self.item else ""
        return f"certificate {self.number}{item} {self.serial}".strip() + f", {self.laboratory}"

    def torques(self) -> Iterator[tuple[str, FloatArray, FloatArray]]:
        """Yield title, torques and U (k = 2) of each table of torques, N·m."""
        found = [(title, pair) for title, each in self.results if (pair := _torques(each))]
        if not found:  # each column may be a result of its own, with single values
            columns = [one for title, each in self.results if (one := _column(title, each))]
            pair = _torques(columns)
            found = [("", pair)] if pair else []
        for title, (torque, expanded) in found:
            yield title, torque, expanded

    def uncertainty(self) -> CertifiedUncertainty:
        """Return U (k = 2) over the torque; from several tables, the larger one.

        Raises
        ------
        InputError
            The certificate states none.
        """
        points: dict[float, float] = {}
        for _, torque, expanded in self.torques():
            for torque_nm, u_nm in zip(torque.tolist(), expanded.tolist(), strict=True):
                points[torque_nm] = max(u_nm, points.get(torque_nm, 0.0))
        if not any(points):
            units = {each.unit for _, quantities in self.results for each in quantities}
            raise InputError(
                Message(
                    "certificate {number} of {laboratory} without torques and their expanded "
                    "uncertainty; its units are {units}",
                    self.number,
                    self.laboratory,
                    ", ".join(sorted(units)) or "none",
                ),
                "a table of torques in N·m with U of the item",
                "state U in %, or as a table with torque_nm and expanded_uncertainty_nm",
            )
        ordered = sorted(points.items())
        certified = CertifiedUncertainty.of_table(*np.array(ordered).T)
        return replace(certified, record=self.record)


def is_dcc(path: Path) -> bool:
    """Return whether a file is a digital calibration certificate, judged by its beginning."""
    try:
        with path.open("rb") as file:
            return NAMESPACE in file.read(8192)
    except OSError:
        return False


def read_dcc(path: Path) -> DigitalCertificate:
    """Return a digital calibration certificate.

    Raises
    ------
    InputError
        The file can't be read, isn't XML, or isn't a certificate.
    """
    try:
        with path.open("rb") as file:
            content = file.read(MOST_BYTES + 1)
    except OSError as error:
        raise InputError(
            Message("can't read {source}: {error}", path, error.strerror),
            "a file that exists and may be read",
        ) from error
    return parse_dcc(content, str(path))


def parse_dcc(content: bytes, origin: str) -> DigitalCertificate:
    """Return the certificate in a file's content; see `read_dcc`."""
    if len(content) > MOST_BYTES:
        size = Message("{origin}: more than {size} MB", origin, MOST_BYTES >> 20)
        raise InputError(size, "a digital calibration certificate")
    if b"<!DOCTYPE" in (plain := content.replace(b"\0", b"")) or b"<!ENTITY" in plain:
        raise InputError(Message("{path}: XML with a document type", origin), "XML without one")
    try:
        root = ElementTree.fromstring(content)
    except ElementTree.ParseError as error:
        raise InputError(
            Message("{path} is no XML: {error}", origin, error), "a digital calibration certificate"
        ) from error
    if _local(root) != "digitalCalibrationCertificate":
        raise InputError(
            Message("{path}: XML with {tag}", origin, _local(root)),
            "a digital calibration certificate",
        )
    try:
        return _certificate(root)
    except RecursionError:
        raise InputError(
            Message("{path}: elements within elements without end", origin),
            "a digital calibration certificate",
        ) from None


def _certificate(root: Element) -> DigitalCertificate:
    core = _first(root, "administrativeData", "coreData")
    laboratory = _first(root, "administrativeData", "calibrationLaboratory", "contact")
    item = _first(root, "administrativeData", "items", "item")
    begin, end = _text(core, "beginPerformanceDate"), _text(core, "endPerformanceDate")
    return DigitalCertificate(
        version=root.get("schemaVersion", ""),
        number=_text(core, "uniqueIdentifier"),
        laboratory=_words(_first(laboratory, "name")),
        country=_text(core, "countryCodeISO3166_1"),
        item=_words(_first(item, "name")),
        serial=_text(_first(item, "identifications", "identification"), "value"),
        performed=begin if begin == end or not end else f"{begin} to {end}",
        issued=_text(core, "issueDate"),
        signed=any(_local(child) == "Signature" for child in root.iter()),
        results=tuple(_results(root)),
    )


def _local(element: Element) -> str:
    return element.tag.rpartition("}")[2]


def _children(element: Element | None, name: str) -> list[Element]:
    return [] if element is None else [child for child in element if _local(child) == name]


def _first(element: Element | None, *names: str) -> Element | None:
    """Follow a path of names through first children; None where one is missing."""
    for name in names:
        element = next(iter(_children(element, name)), None)
    return element


def _text(element: Element | None, *names: str) -> str:
    found = _first(element, *names)
    return "" if found is None else " ".join("".join(found.itertext()).split())


def _words(element: Element | None) -> str:
    """Return a text, in English if it exists in several languages."""
    contents = _children(element, "content")
    if not contents:
        return _text(element) if element is not None else ""
    english = [each for each in contents if each.get("lang", "").startswith("en")]
    return " ".join("".join((english or contents)[0].itertext()).split())


def _results(root: Element) -> Iterator[tuple[str, tuple[DccQuantity, ...]]]:
    for measured in _children(_first(root, "measurementResults"), "measurementResult"):
        for result in _children(_first(measured, "results"), "result"):
            title = _words(_first(result, "name")) or _words(_first(measured, "name"))
            for quantities in _tables(_first(result, "data")):
                yield title, quantities


def _tables(data: Element | None) -> Iterator[tuple[DccQuantity, ...]]:
    """Yield the groups of quantities that belong together, list by list."""
    if data is None:
        return
    found = [each for child in _children(data, "quantity") if (each := _quantity(child))]
    if found:
        yield tuple(found)
    for child in data:
        if _local(child) in ("list", "data"):
            yield from _tables(child)


def _quantity(element: Element) -> DccQuantity | None:
    """Return a quantity with numbers; of several units, the one in N·m."""
    hybrid = _children(element, "hybrid")
    forms = [each for parent in (*hybrid, element) for each in parent if _local(each) in _FORMS]
    parsed = [found for form in forms if (found := _numbers(form)) is not None]
    if not parsed:
        return None
    parsed.sort(key=lambda each: _newton_metres(each[0]) is None)
    unit, values, expanded = parsed[0]
    relative = None if expanded is not None else _relative(element)
    kinds = tuple((element.get("refType") or "").split())
    name = _words(_first(element, "name"))
    if relative is not None:
        return DccQuantity(name, kinds, unit, values, _repeated(relative, values), True)
    return DccQuantity(name, kinds, unit, values, expanded)


_FORMS = ("realListXMLList", "real", "realList", "list")
_UNCERTAINTIES = (
    # element of the uncertainty, its value, its coverage factor; by versions of the D-SI
    ("expandedMUXMLList", "valueExpandedMUXMLList", "coverageFactorXMLList"),
    ("expandedMU", "valueExpandedMU", "coverageFactor"),
    ("expandedUncXMLList", "uncertaintyXMLList", "coverageFactorXMLList"),
    ("expandedUnc", "uncertainty", "coverageFactor"),
)
_STANDARD = (
    ("standardMUXMLList", "valueStandardMUXMLList"),
    ("standardMU", "valueStandardMU"),
)


def _numbers(form: Element) -> tuple[str, FloatArray, FloatArray | None] | None:
    """Return unit, values and U (k = 2) of a number or a list of numbers."""
    if _local(form) in ("realList", "list"):
        return _joined(form)
    values = _floats(_text(form, "valueXMLList") or _text(form, "value"))
    unit = _text(form, "unitXMLList") or _text(form, "unit")
    unit = unit.split()[0] if unit else ""
    if values is None:
        return None
    return unit, values, _expanded(form, values)


def _joined(form: Element) -> tuple[str, FloatArray, FloatArray | None] | None:
    """Return single numbers as a list; unit and uncertainty may be stated once for all."""
    inner = _children(form, "realList")
    reals = _children(form, "real")
    if not reals:
        return _joined(inner[0]) if inner else None
    parts = [each for child in reals if (each := _numbers(child)) is not None]
    if len(parts) < len(reals):
        return None
    values = np.concatenate([part[1] for part in parts])
    expanded = [part[2] for part in parts]
    known = [each for each in expanded if each is not None]
    u = np.concatenate(known) if len(known) == len(parts) else None
    if u is None and (stated := _first(form, "listUnivariateUnc")) is not None:
        u = _expanded(stated, values)
    return _text(form, "listUnit") or parts[0][0], values, u


def _expanded(form: Element, values: FloatArray) -> FloatArray | None:
    """Return U (k = 2) of numbers; None if it isn't stated with its coverage factor."""
    for element in form.iter():
        for name, value, factor in _UNCERTAINTIES:
            if _local(element) == name:
                stated, k = _floats(_text(element, value)), _floats(_text(element, factor))
                if stated is not None and k is not None and (k > 0.0).all():
                    return _NOMINAL_FACTOR * _repeated(stated, values) / _repeated(k, values)
        for name, value in _STANDARD:
            if _local(element) == name and (stated := _floats(_text(element, value))) is not None:
                return _NOMINAL_FACTOR * _repeated(stated, values)
    return None


def _relative(element: Element) -> FloatArray | None:
    """Return a relative expanded uncertainty (k = 2) of a quantity."""
    stated = _first(element, "relativeUncertainty")
    for child in () if stated is None else stated.iter():
        found = _numbers(child) if _local(child) in _FORMS else None
        if found is not None:
            unit, values, _ = found
            return values * (1e-2 if unit == r"\percent" else 1.0)
    return None


def _floats(text: str) -> FloatArray | None:
    try:
        values = np.array([float(part) for part in text.split()])
    except ValueError:
        return None
    return values if values.size and np.isfinite(values).all() else None


def _repeated(values: FloatArray, like: FloatArray) -> FloatArray:
    """Return one value for each of others, repeating a value that is stated for all."""
    return np.full(like.size, values[0]) if values.size == 1 else values


def _newton_metres(unit: str) -> float | None:
    r"""Return the N·m per unit written as in the D-SI or by a person; None for other units.

    >>> units = r"\kilo\newton\metre", r"\newton\metre\tothe{-1}", "kN·m"
    >>> [_newton_metres(each) for each in units]
    [1000.0, None, 1000.0]
    """
    if not unit.startswith("\\"):
        plain = unit_named(unit, "torque") if unit else None
        return plain.factor if plain else None
    parts = [part for part in unit.strip().split("\\") if part]
    factor, units = 1.0, []
    for part in parts:
        if part in _PREFIXES:
            factor *= _PREFIXES[part]
        else:
            units.append(part.replace("meter", "metre"))
    return factor if sorted(units) == ["metre", "newton"] else None


def _torques(quantities: Sequence[DccQuantity]) -> tuple[FloatArray, FloatArray] | None:
    """Return the torques of a table and their U (k = 2) for the item, N·m."""
    torques = [each for each in quantities if each.nm is not None and not _is_uncertainty(each)]
    if not torques:
        return None
    reference = next((each for each in torques if each.is_reference), torques[0])
    assert reference.nm is not None
    torque = reference.values * reference.nm
    others = (quantity for quantity in quantities if quantity is not reference)
    stated = [u for u in (_of_item(quantity, torque) for quantity in others) if u is not None]
    if not stated and (of_reference := _of_item(reference, torque)) is not None:
        stated = [of_reference]
    fitting = [u for u in stated if u.shape == torque.shape]
    return (torque, np.max(fitting, axis=0)) if fitting else None


def _column(title: str, quantities: Sequence[DccQuantity]) -> DccQuantity | None:
    """Return a result's single values of one unit as a column with the result's title."""
    units = {each.unit for each in quantities}
    if len(units) != 1 or any(each.values.size != 1 or each.relative for each in quantities):
        return None
    values = np.concatenate([each.values for each in quantities])
    known = [each.expanded for each in quantities if each.expanded is not None]
    expanded = np.concatenate(known) if len(known) == len(quantities) else None
    return DccQuantity(title, (), units.pop(), values, expanded)


def _is_uncertainty(quantity: DccQuantity) -> bool:
    return any(_UNCERTAINTY.search(text) for text in (*quantity.kinds, quantity.name))


def _of_item(quantity: DccQuantity, torque: FloatArray) -> FloatArray | None:
    """Return a quantity's U (k = 2) at given torques, N·m; None if it states none."""
    values, expanded = quantity.values, quantity.expanded
    if _is_uncertainty(quantity) and values.shape == torque.shape:
        if quantity.nm is not None:
            return values * quantity.nm
        shares = {r"\percent": 1e-2, "%": 1e-2, r"\one": 1.0}
        if quantity.unit in shares:
            return np.abs(torque) * values * shares[quantity.unit]
    if expanded is None or expanded.shape != torque.shape:
        return None
    if quantity.relative:
        return np.abs(torque) * expanded
    if quantity.nm is not None:
        return expanded * quantity.nm
    if values.shape != torque.shape or np.ptp(torque) == 0.0:
        return None
    slope = float(np.polyfit(torque, values, 1)[0])  # of a signal, to convert its U to a torque
    return expanded / abs(slope) if slope else None
