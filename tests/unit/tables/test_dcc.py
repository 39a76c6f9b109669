"""Digital certificates of other institutes: U of a torque standard in every version and form.

The certificates are written here, from the schemas, and validated by them; U is known beforehand.
"""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from dcclib.validation import XsdValidator
from dcclib.validation.xsd import SchemaVersion
from lxml import etree
from tests.digital_certificates import BRIDGE, KNM, NM, VERSIONS, certificate, new_list, quantity

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


def test_of_both_directions_each_counts_and_of_several_results_the_larger(tmp_path: Path) -> None:
    def pair(torque: Any, u: Any) -> list[str]:
        columns = (("Reference", "basic_referenceValue", None), ("Measured", "basic_measured", u))
        return [quantity(new_list(torque, NM, of), name, kind, "3.3") for name, kind, of in columns]

    path = tmp_path / "standard.xml"
    lists = pair(TORQUE, U), pair([-100, -1000], [0.2, 0.9]), pair([400.0], [0.7])
    path.write_text(certificate("3.3.0", *lists), encoding="utf-8")
    found = read_dcc(path).uncertainty().at([100.0, 400.0, 1000.0, -100.0, -1000.0])
    np.testing.assert_allclose(found, [0.05, 0.7, 0.3, 0.2, 0.9])


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
