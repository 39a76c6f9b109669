"""Digital calibration certificates of another laboratory, written from the schemas alone."""

from typing import Any

import numpy as np

NM, KNM, BRIDGE = r"\newton\metre", r"\kilo\newton\metre", r"\milli\volt\volt\tothe{-1}"


def tag(name: str, *content: str, **attributes: str) -> str:
    stated = "".join(f' {key}="{value}"' for key, value in attributes.items())
    return f"<{name}{stated}>{''.join(content)}</{name.split()[0]}>"


def dcc(path: str, *content: str) -> str:
    """Return nested elements of the DCC by their path."""
    inner = "".join(content)
    for name in reversed(path.split("/")):
        inner = tag(f"dcc:{name}", inner)
    return inner


def named(german: str, english: str) -> str:
    words = {"de": german, "en": english}
    return dcc("name", *(tag("dcc:content", text, lang=key) for key, text in words.items()))


def numbers(values: Any) -> str:
    return " ".join(f"{value:.10g}" for value in np.atleast_1d(np.asarray(values, dtype=float)))


def xml_list(values: Any, unit: str, u: Any = None, k: float = 2.0, new: bool = False) -> str:
    """Write numbers as versions from 3.1 on do, and from 3.3 on with other names."""
    stated = ""
    if u is not None:
        name = "valueExpandedMUXMLList" if new else "uncertaintyXMLList"
        parts = (
            tag(f"si:{name}", numbers(u)),
            tag("si:coverageFactorXMLList", f"{k:g}"),
            tag("si:coverageProbabilityXMLList", "0.95"),
        )
        if new:
            inner = tag("si:expandedMUXMLList", *parts)
            stated = tag("si:measurementUncertaintyUnivariateXMLList", inner)
        else:
            stated = tag("si:expandedUncXMLList", *parts)
    shown = tag("si:valueXMLList", numbers(values)), tag("si:unitXMLList", unit)
    return tag("si:realListXMLList", *shown, stated)


def new_list(values: Any, unit: str, u: Any = None, k: float = 2.0) -> str:
    return xml_list(values, unit, u, k, new=True)


def reals(values: Any, unit: str, u: Any = None, k: float = 2.0) -> str:
    """Write numbers as versions before 3.1 do: one element each, with the unit once."""
    row = np.atleast_1d(np.asarray(values, dtype=float))

    def expanded(share: float) -> str:
        return tag(
            "si:expandedUnc",
            tag("si:uncertainty", f"{share:.10g}"),
            tag("si:coverageFactor", f"{k:g}"),
            tag("si:coverageProbability", "0.95"),
        )

    common, shares = "", [""] * row.size
    if u is not None and np.ndim(u) == 0:
        common = tag("si:listUnivariateUnc", expanded(float(u)))
    elif u is not None:
        shares = [expanded(share) for share in np.asarray(u, dtype=float).tolist()]
    each = (
        tag("si:real", tag("si:value", f"{value:.10g}"), share)
        for value, share in zip(row.tolist(), shares, strict=True)
    )
    return tag("si:listUnit", unit) + common + "".join(each)


def list_2(values: Any, unit: str, u: Any = None, k: float = 2.0) -> str:
    return tag("si:list", reals(values, unit, u, k))


def list_3_0(values: Any, unit: str, u: Any = None, k: float = 2.0) -> str:
    return tag("si:list", tag("si:realList", reals(values, unit, u, k)))


VERSIONS = {
    "2.4.0": list_2,
    "3.0.0": list_3_0,
    "3.1.2": xml_list,
    "3.2.1": xml_list,
    "3.3.0": new_list,
}


def quantity(content: str, words: str, kind: str, version: str) -> str:
    refers = {"refType": kind} if version >= "3.1" else {}
    return tag("dcc:quantity", named(f"{words} (de)", words), content, **refers)


def certificate(version: str, *lists: list[str]) -> str:
    """Return a certificate of a torque transducer of another laboratory."""
    software = dcc("software", dcc("name/content", "x"), dcc("release", "v1.0.0"))
    where = dcc("eMail", "a@b.example") + dcc("location/city", "X")
    party = dcc("name/content", "Labor AG") + where
    described = dcc("description/content", "x") if version < "3" else ""
    maker = described + dcc("manufacturer/name/content", "M")
    serial = dcc("identification", dcc("issuer", "manufacturer"), dcc("value", "T-99"))
    languages = "".join(dcc("usedLangCodeISO639_1", each) for each in ("de", "en"))
    core = dcc(
        "coreData",
        dcc("countryCodeISO3166_1", "DE"),
        languages,
        dcc("mandatoryLangCodeISO639_1", "de"),
        dcc("uniqueIdentifier", "K-2026-17"),
        dcc("beginPerformanceDate", "2026-03-02"),
        dcc("endPerformanceDate", "2026-03-03"),
        dcc("performanceLocation", "laboratory") if version >= "3" else "",
    )
    name = named("Drehmomentaufnehmer", "Torque transducer")
    item = name + maker + dcc("identifications", serial)
    person = dcc("person/name/content", "A. Prüfer") + dcc("mainSigner", "true")
    climate = tag("si:real", tag("si:value", "21"), tag("si:unit", r"\degreecelsius"))
    administrative = dcc(
        "administrativeData",
        dcc("dccSoftware", software),
        core,
        dcc("items/item", item),
        dcc("calibrationLaboratory/contact", party),
        dcc("respPersons/respPerson", person),
        dcc("customer", party),
    )
    results = dcc(
        "measurementResults/measurementResult",
        named("Ergebnis", "result") if version >= "3" else "",
        dcc("usedMethods/usedMethod", named("Vergleich", "comparison"), described),
        dcc("usedSoftware", software) if version >= "3.3" else "",
        dcc("measuringEquipments/measuringEquipment", named("Normal", "standard"), maker),
        dcc(
            "influenceConditions/influenceCondition",
            named("Klima", "climate"),
            dcc("data/quantity", named("T", "T"), climate),
        ),
        dcc(
            "results/result",
            named("Rechtsdrehmoment", "clockwise"),
            dcc("data", *(dcc("list", *quantities) for quantities in lists)),
        ),
    )
    return tag(
        "dcc:digitalCalibrationCertificate",
        administrative,
        results,
        **{"xmlns:dcc": "https://ptb.de/dcc", "xmlns:si": "https://ptb.de/si"},
        schemaVersion=version,
    )
