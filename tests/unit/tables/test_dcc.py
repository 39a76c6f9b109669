"""Digital certificates of other institutes: U of a torque standard in every version and form.

The certificates are written here, from the schemas, and validated by them; U is known beforehand.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from dcclib.validation import XsdValidator
from dcclib.validation.xsd import SchemaVersion
from lxml import etree
from tests.digital_certificates import (
    BRIDGE,
    KNM,
    NM,
    VERSIONS,
    certificate,
    dcc,
    named,
    new_list,
    quantity,
    tag,
)
from tests.support import draws

from torquebench.bench.certificates.torque import read_uncertainty
from torquebench.errors import InputError
from torquebench.tables import is_dcc, read_dcc

TORQUE = (100.0, 400.0, 1000.0)
U = (0.05, 0.1, 0.3)
"""U (k = 2) of the standard at these, N·m."""


def forms(version: str) -> dict[str, list[str]]:
    """Return U in the forms in which laboratories state it."""
    write, torque, u = VERSIONS[version], np.array(TORQUE), np.array(U)

    def column(words: str, kind: str, *values: Any) -> str:
        return quantity(write(*values), words, kind, version)

    def reference(values: Any = torque, unit: str = NM) -> str:
        return column("Reference value", "basic_referenceValue", values, unit)

    def measured(*values: Any) -> str:
        return column("Measured value", "basic_measuredValue", *values)

    error = column("Measurement error", "basic_measurementError", [0.01, 0.02, -0.05], NM, U)
    stated = column("Expanded uncertainty", "x_u", U, NM)
    percent = column("Relative uncertainty W", "x_w", 100.0 * u / torque, r"\percent")
    return {
        "error": [reference(), error],
        "kN·m": [reference(1e-3 * torque, KNM), measured(1e-3 * torque, KNM, 1e-3 * u)],
        "mV/V": [reference(), measured(2e-3 * torque, BRIDGE, 2e-3 * u)],
        "k 2.5": [reference(), measured(torque, NM, 1.25 * u, 2.5)],
        "k 1": [reference(), measured(torque, NM, 0.5 * u, 1.0)],
        "own column": [reference(), measured(torque, NM), stated],
        "percent": [reference(), measured(torque, NM), percent],
        "item first": [measured(torque, NM, U), reference()],
        "one for all": [reference(), measured(torque, NM, 0.2)],
    }


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("form", list(forms("3.3.0")))
def test_u_is_that_of_the_certificate(tmp_path: Path, version: str, form: str) -> None:
    xml = certificate(version, forms(version)[form])
    schema = SchemaVersion[f"v{version.replace('.', '_')}"]
    checked = XsdValidator.from_version(schema).validate_tree(etree.fromstring(xml))
    assert checked.is_valid, [each.message for each in checked.errors]
    path = tmp_path / "standard.xml"
    path.write_text(xml, encoding="utf-8")
    assert is_dcc(path)
    expected = [0.2] * len(U) if form == "one for all" else U
    np.testing.assert_allclose(read_uncertainty(path).at(TORQUE), expected, rtol=1e-6)
    found = read_dcc(path)
    assert (found.version, found.number, found.serial) == (version, "K-2026-17", "T-99")
    assert (found.item, found.laboratory) == ("Torque transducer", "Labor AG")
    assert found.performed == "2026-03-02 to 2026-03-03"
    assert not found.signed


RELEASES = [each.name[1:].replace("_", ".") for each in SchemaVersion if each.name >= "v2_4"]
NEWTON_METRES = {
    NM: 1.0,
    r"\metre\newton": 1.0,
    KNM: 1e3,
    r"\milli\newton\metre": 1e-3,
    r"\newton\centi\metre": 1e-2,
    r"\mega\newton\metre": 1e6,
}
SIGNALS = {BRIDGE: "Anzeige", r"\hertz": "Frequency", r"\volt": "Output", r"\kilo\hertz": "f"}


def drawn(seed: int) -> tuple[str, list[list[str]], dict[float, float]]:
    """Draw a release of the schema, its lists, and U (k = 2) at each torque, N·m."""
    rng = np.random.default_rng(seed)
    version = RELEASES[seed % len(RELEASES)]
    write = next(VERSIONS[each] for each in sorted(VERSIONS, reverse=True) if each <= version)
    largest, known = 10.0 ** rng.uniform(-1.0, 4.0), dict[float, float]()

    def of(values: Any, words: str, kind: str, unit: str, u: Any = None, k: float = 2.0) -> str:
        return quantity(write(values, unit, u, k), words, kind, version)

    def tables() -> Iterator[list[str]]:
        for _ in range(rng.integers(1, 4)):
            size = int(rng.integers(2, 12))
            torque = largest * rng.uniform(0.02, 1.0, size) * rng.choice([-1.0, 1.0])
            unit, other = rng.choice(list(NEWTON_METRES), 2)
            here, there = torque / NEWTON_METRES[unit], torque / NEWTON_METRES[other]
            k = float(rng.choice([1.0, 2.0, 2.13, 3.0]))
            share = rng.uniform(1e-4, 5e-3, size)
            u = np.full(size, share[0] * largest) if rng.random() < 0.3 else share * np.abs(torque)
            stated = u * k / 2.0 / NEWTON_METRES[other]
            reference = of(here, "Bezugswert", "basic_referenceValue", unit)
            form = rng.integers(5)
            if form == 0:
                item = [of(there, "Indication", "basic_measuredValue", other, stated, k)]
            elif form == 1:
                error = [of(1e-3 * there, "Abweichung", "basic_measurementError", other, stated, k)]
                item = [of(there, "Anzeige", "basic_measuredValue", other), *error]
            elif form == 2:
                signal, slope = str(rng.choice(list(SIGNALS))), rng.uniform(1e-4, 1e4)
                value, zero = slope * torque, rng.choice([0.0, 100.0 * slope * largest])
                read = of(zero + value, SIGNALS[signal], "x_y", signal, u * slope * k / 2.0, k)
                item = [read]
            elif form == 3:
                column = u / NEWTON_METRES[other]
                item = [of(column, "erweiterte Messunsicherheit U", "x_u", other)]
            else:
                percent = bool(rng.random() < 0.5)
                relative = u / np.abs(torque) * (100.0 if percent else 1.0)
                said = of(
                    relative, "expanded uncertainty", "x_w", r"\percent" if percent else r"\one"
                )
                item = [of(there, "Anzeige", "basic_measuredValue", other), said]
            yield [reference, *item] if form == 3 or rng.random() < 0.7 else [*item, reference]
            for at, u_nm in zip(torque.tolist(), u.tolist(), strict=True):
                known[at] = u_nm
        if rng.random() < 0.5:
            yield [of([20.1, 20.4], "Temperature", "basic_measuredValue", r"\degreecelsius", 0.2)]

    return version, list(tables()), known


@pytest.mark.parametrize("seed", draws.drawn(60, by_day=15))
def test_certificates_of_every_release(tmp_path: Path, seed: int) -> None:
    """Units, coverage factors, directions, orders, forms of U, lists beside them are drawn."""
    version, lists, known = drawn(seed)
    xml = certificate(version, *lists)
    schema = SchemaVersion[f"v{version.replace('.', '_')}"]
    checked = XsdValidator.from_version(schema).validate_tree(etree.fromstring(xml))
    assert checked.is_valid, [each.message for each in checked.errors]
    path = tmp_path / "standard.xml"
    path.write_text(xml, encoding="utf-8")
    torque = list(known)
    np.testing.assert_allclose(
        read_uncertainty(path).at(torque), [known[at] for at in torque], rtol=1e-5
    )


def test_of_both_directions_each_counts_and_of_several_results_the_larger(tmp_path: Path) -> None:
    def pair(torque: Any, u: Any) -> list[str]:
        columns = (("Reference", "basic_referenceValue", None), ("Measured", "basic_measured", u))
        return [quantity(new_list(torque, NM, of), name, kind, "3.3") for name, kind, of in columns]

    path = tmp_path / "standard.xml"
    lists = pair(TORQUE, U), pair([-100, -1000], [0.2, 0.9]), pair([400.0], [0.7])
    path.write_text(certificate("3.3.0", *lists), encoding="utf-8")
    found = read_dcc(path).uncertainty().at([100.0, 400.0, 1000.0, -100.0, -1000.0])
    np.testing.assert_allclose(found, [0.05, 0.7, 0.3, 0.2, 0.9])


@pytest.mark.parametrize("unit", [NM, "N·m", "kN·m"])
def test_columns_that_are_results_of_their_own_are_one_table(tmp_path: Path, unit: str) -> None:
    """So a national institute states forces: plain units, a result with single values each."""
    factor = 1e3 if unit == "kN·m" else 1.0
    columns = {
        "Indicated Torque": (np.array(TORQUE) * 1.001 / factor, unit),
        "Applied Torque": (np.array(TORQUE) / factor, unit),
        "Relative Expanded Uncertainty": (100.0 * np.array(U) / TORQUE, "%"),
        "Relative Repeatability Error": (np.full(3, 0.01), "%"),
    }
    results = ""
    for words, (values, of) in columns.items():
        singles = [
            dcc("quantity", tag("si:real", tag("si:value", f"{value:.9g}"), tag("si:unit", of)))
            for value in values
        ]
        results += dcc("result", named(words, words), dcc("data", *singles))
    xml = certificate("3.3.0", [])
    start, end = xml.index("<dcc:result>"), xml.index("</dcc:results>")
    path = tmp_path / "standard.xml"
    path.write_text(xml[:start] + results + xml[end:], encoding="utf-8")
    np.testing.assert_allclose(read_uncertainty(path).at(TORQUE), U, rtol=1e-6)


KELVIN = [quantity(new_list([1, 2], r"\kelvin", 0.1), "T", "x", "3.3")]
BARE = [quantity(new_list(TORQUE, NM), "M", "x", "3.3")]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("<a/>", "XML with a"),
        ("<a", "no XML"),
        (certificate("3.3.0", ["<dcc:list>" * 20_000 + "</dcc:list>" * 20_000]), "without end"),
        ('<!DOCTYPE a [<!ENTITY b "c">]><a>&b;</a>', "document type"),
        (certificate("3.3.0", []), "without torques"),
        (certificate("3.3.0", KELVIN), r"its units are \\kelvin"),
        (certificate("3.3.0", BARE), "without torques and their expanded uncertainty"),
    ],
)
def test_what_states_no_uncertainty_is_refused(tmp_path: Path, content: str, message: str) -> None:
    path = tmp_path / "standard.xml"
    path.write_text(content, encoding="utf-8")
    with pytest.raises(InputError, match=message):
        read_dcc(path).uncertainty()
