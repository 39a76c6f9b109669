"""Content of the PDF for the template: texts and numbers in one language."""

from collections.abc import Sequence
from datetime import date
from typing import Any

from torquebench.message import Message
from torquebench.records.signatures import how
from torquebench.reports.certificate.labels import Labels, labels_of
from torquebench.reports.certificate.record import (
    Act,
    BudgetRow,
    CertificateRecord,
    Conformity,
    Party,
    ResultRow,
)
from torquebench.reports.certificate.static_content import (
    MOST_ROWS,
    listed_steps,
    static_content,
)
from torquebench.uncertainty import Verdict

_ARROWS = {1: "↑", -1: "↓", 0: ""}


def certificate_content(record: CertificateRecord, language: str) -> dict[str, Any]:
    """Return all texts and numbers that the template needs.

    Parameters
    ----------
    record : CertificateRecord
    language : str

    Returns
    -------
    dict
        Texts and lists of texts; None hides a part.
    """
    words = labels_of(language)
    return {
        "language": language,
        "title": words["title"],
        "number": record.number,
        "payload": record.payload,
        "issued": record.issued.isoformat(),
        "authors": list(record.authorised_by),
        "laboratory_name": record.laboratory.name,
        "banner": _banner(record, words),
        "supersedes": f"{words['supersedes']} {record.supersedes}" if record.supersedes else None,
        "page": words["page"],
        "closing": words["closing"],
        "facts": _facts(record, words),
        "conformity": _conformity(record, words),
        "deviations": {"title": words["deviations"], "entries": _deviations(record, words)},
        "verification": _verification(record, words),
        "figure": words[_word("figure", record)],
        "static": static_content(record, words),
        "results": _results(record, words),
        "budget": _budget(record, words),
        "turning": _turning(record, words),
        "records": _records(record, words),
        "annex": words["annex"],
    }


def _word(key: str, record: CertificateRecord) -> str:
    """Return the key of a label, or of its variant for certificates without compensation."""
    return key if record.compensation else f"{key}_raw"


def _banner(record: CertificateRecord, words: Labels) -> str | None:
    """Return the warning that stands on every page; None without a warning."""
    shown = [words[key] for key in ("draft", "simulated") if getattr(record, key)]
    if record.unreviewed:
        shown.append(unreviewed_words(record, words))
    return " · ".join(shown) or None


def unreviewed_words(record: CertificateRecord, words: Labels) -> str:
    """Name what no second person or fresh points confirmed."""
    reasons = ", ".join(words[f"unreviewed_{each}"] for each in record.unreviewed)
    return f"{words['unreviewed']}: {reasons}"


def not_in_u_words(record: CertificateRecord, words: Labels) -> str:
    """List the influences that U doesn't contain."""
    return ", ".join(words.said(name) for name in record.not_in_u)


def chain_words(record: CertificateRecord, words: Labels) -> str:
    """Name the measuring chain and its side of the bench."""
    side = record.item.side
    return ", ".join(
        [words["chain"], *([words.said(Message("{side} side", side))] if side else [])]
    )


def _facts(record: CertificateRecord, words: Labels) -> list[tuple[str, list[str]]]:
    item, reference = record.item, record.reference
    unknown = words["not_stated"]
    transducer = " ".join(part for part in (item.manufacturer, item.model) if part) or unknown
    traceability = [
        words[reference.label].format(
            model=reference.model or unknown,
            serial=reference.serial,
            certificate=reference.certificate_number or unknown,
            percent=words.short(reference.expanded_uncertainty_percent),
        ),
        words["reference_due"].format(
            performed=_day(reference.performed, unknown), due=_day(reference.due, unknown)
        ),
    ]
    if reference.laboratory:
        traceability.append(reference.laboratory)
    return [
        (words["laboratory"], _party(record.laboratory, unknown)),
        (words["customer"], _party(record.customer, unknown)),
        (
            words["item"],
            [
                chain_words(record, words),
                f"{words['transducer']}: {transducer}, {words['serial']} {item.serial}",
                f"{words['counter']}: {item.counter_identity}",
                f"{words['bench']}: {item.bench or unknown}",
                f"{words['range']}: ±{words.short(item.range_nm)} N·m",
            ],
        ),
        (
            words["method"],
            _method(record, words),
        ),
        (words["reference"], traceability),
        *((words.said(label), [words.said(text)]) for label, text in record.stated()),
        *([(words["not_in_u"], [not_in_u_words(record, words)])] if record.not_in_u else []),
        (words["environment"], [_environment(record, words)]),
        (words["place"], [place_words(record, words)]),
        (words["date_calibration"], [_period(record)]),
        (words["date_issue"], [record.issued.isoformat()]),
        (words["measured_by"], _person("measured", record.measured_by or unknown, record, words)),
        (words["checked_by"], _person("checked", words["nobody"], record, words)),
        *(
            [(words["used_by"], used)]
            if (used := _person("used", "", record, words)) != [""]
            else []
        ),
        (words["authorised_by"], _person("authorised", words["nobody"], record, words)),
        (words["signatures"], [words["signatures_text"]]),
        (words["validity"], [words["validity_text"]]),
    ]


def _person(role: str, otherwise: str, record: CertificateRecord, words: Labels) -> list[str]:
    """Return the persons in a role and how each was authenticated."""
    acts = [act for act in record.acts if act.role == role and act.name]
    return [line for act in acts for line in (act.name, f"– {act_words(act, words)}")] or [
        otherwise
    ]


def act_words(act: Act, words: Labels) -> str:
    """State how and when a person was authenticated, and who set their password shortly before."""
    parts = [words.said(how(act.signature))]
    if act.moment is not None:
        parts.append(f"{act.moment:%Y-%m-%d %H:%M} UTC")
    parts += [
        words["password_set"].format(by=by, date=day.isoformat()) for day, by in act.password_set
    ]
    return "; ".join(parts)


def place_words(record: CertificateRecord, words: Labels) -> str:
    """State the place of calibration."""
    item = record.item
    where = item.bench or words["not_stated"]
    return words["place_in_bench"].format(bench=where) if item.in_place else where


def _method(record: CertificateRecord, words: Labels) -> list[str]:
    """State the calibration method and the range."""
    method, range_nm = record.method, record.item.range_nm
    how = [words["method_text"].format(series=method.series, points=method.points)]
    largest_nm = max(abs(row.torque_nm) for row in record.results)
    if largest_nm < 0.99 * range_nm:
        percent = words.short(100.0 * largest_nm / range_nm)
        text = words["calibrated_up_to"]
        how.append(text.format(torque=words.short(largest_nm), percent=percent))
    if method.placement is not None:
        even, placed, rounds = method.placement
        how.append(words["placement"].format(even=even, placed=placed, rounds=rounds))
    verified = words["profile_verified" if method.verified else "profile_unverified"]
    return [*how, f"{words['profile']}: {method.name}", verified]


def _party(party: Party, unknown: str) -> list[str]:
    if not party.name:
        return [unknown]
    place = " ".join(part for part in (party.post_code, party.city, party.country) if part)
    return [party.name, ", ".join(part for part in (party.street, place, party.email) if part)]


def _environment(record: CertificateRecord, words: Labels) -> str:
    if record.temperature_c is None:
        return words["temperature_unknown"]
    low, high = (words.number(value, 1) for value in record.temperature_c)
    return words["temperature_range"].format(low=low, high=high)


def _period(record: CertificateRecord) -> str:
    first, last = record.calibrated_from.isoformat(), record.calibrated_to.isoformat()
    return first if first == last else f"{first} – {last}"


def _day(day: date | None, unknown: str) -> str:
    return unknown if day is None else day.isoformat()


def _conformity(record: CertificateRecord, words: Labels) -> dict[str, str] | None:
    found = record.conformity
    if found is None:
        return None
    return {
        "title": words["conformity"],
        "verdict": words.said(found.verdict.label),
        "tolerance": words[_word("conformity_text", record)].format(
            tolerance=words.short(found.tolerance_percent_fs),
            limit=words.short(found.tolerance_percent_fs / 100.0 * record.item.range_nm),
        ),
        "decides": _deciding_error(found, words),
        "counts": _counts(found, words),
        "rule": words["rule"],
    }


def _deciding_error(conformity: Conformity, words: Labels) -> str:
    """Return the sentence that names the largest error, with its U, which decides conformity."""
    error, expanded = words.pair(conformity.worst_error_nm, conformity.expanded_nm)
    sentence = words["conformity_decides_fresh" if conformity.fresh else "conformity_decides"]
    return sentence.format(torque=words.short(conformity.at_nm), error=error, expanded=expanded)


def _counts(found: Conformity, words: Labels) -> str:
    counted = [
        f"{words.said(Verdict(verdict).label)} {count}"
        for verdict, count in found.counts.items()
        if count
    ]
    mark = "，" if words.language == "zh" else ", "
    return mark.join(counted) + ("。" if words.language == "zh" else ".")


def _deviations(record: CertificateRecord, words: Labels) -> list[str]:
    entries = [words.said(str(deviation)) for deviation in record.deviations]
    return entries or [words["deviations_none"]]


def _verification(record: CertificateRecord, words: Labels) -> dict[str, str] | None:
    if not record.compensation:
        return None
    return {"title": words["verification"], "text": verification_words(record, words)}


def verification_words(record: CertificateRecord, words: Labels) -> str:
    """State the results of the verification at fresh points."""
    found = record.verification
    if found is None:
        return words["verification_none"]
    text = words["verification_text"].format(
        date=found.performed.isoformat(),
        points=found.points,
        groups=found.groups,
        before=words.short(found.worst_before_nm, 2),
        after=words.short(found.worst_after_nm, 2),
    )
    if found.averaged_after_nm is not None:
        averaged = words.short(found.averaged_after_nm, 2)
        text = f"{text} {words['verification_averaged'].format(averaged=averaged)}"
    judged = found.conformity
    if judged is not None:
        text = f"{text} {_deciding_error(judged, words)} {_counts(judged, words)}"
    return text


def _results(record: CertificateRecord, words: Labels) -> dict[str, Any]:
    pair = [f"{words['error']}\nN·m", "U\nN·m"]
    compensated, judged = bool(record.compensation), record.conformity is not None
    compensation = words.said(record.compensation)
    shown = _shown(record)
    return {
        "title": words[_word("results", record)],
        "text": words[_word("results_text", record)].format(compensation=compensation),
        "before": words["before"] if compensated else "",
        "after": words["after"] if compensated else None,
        "judged": judged,
        "header": [
            f"{words['torque']}\nN·m",
            "",
            words["readings"],
            *pair,
            *(pair if compensated else []),
            *([words["verdict"]] if judged else []),
        ],
        "rows": [_row(row, words) for row in shown],
        "left_out": words["in_annex"].format(shown=len(shown), all=len(record.results))
        if len(shown) < len(record.results)
        else None,
        "all": [_row(row, words) for row in record.results]
        if len(shown) < len(record.results)
        else None,
    }


def _shown(record: CertificateRecord) -> list[ResultRow]:
    """Return the table's rows: all of them, or with many steps those of `listed_steps`.

    The steps that decide conformity and budget are always listed.
    """
    steps = {row.torque_nm for row in record.results}
    if len(steps) <= MOST_ROWS:
        return list(record.results)
    listed = listed_steps(steps, record.item.range_nm)
    listed.add(record.results[record.budget_step].torque_nm)
    if record.conformity is not None and not record.conformity.fresh:
        listed.add(record.conformity.at_nm)
    return [row for row in record.results if row.torque_nm in listed]


def _row(row: ResultRow, words: Labels) -> list[str]:
    return [
        words.short(row.torque_nm),
        _ARROWS[row.branch],
        str(row.readings),
        *words.pair(row.error_before_nm, row.expanded_before_nm),
        *(
            []
            if row.error_after_nm is None or row.expanded_after_nm is None
            else words.pair(row.error_after_nm, row.expanded_after_nm)
        ),
        *([] if row.verdict is None else [words.said(row.verdict.label)]),
    ]


def _budget(record: CertificateRecord, words: Labels) -> dict[str, Any]:
    row = record.results[record.budget_step]
    _, expanded_nm, factor = row.judged
    freedom = _freedom(record.budget_freedom, words)
    return {
        "title": words["budget"],
        "text": words[_word("budget_text", record)].format(
            torque=words.short(row.torque_nm), branch=_ARROWS[row.branch]
        ),
        **_lines(record.budget, expanded_nm, factor, freedom, words),
    }


def _turning(record: CertificateRecord, words: Labels) -> dict[str, Any] | None:
    """Return the budget during rotation; None if that wasn't measured."""
    found = record.turning_budget
    if found is None:
        return None
    return {
        "title": words["budget_turning"],
        "text": words["budget_text_turning"].format(
            torque=words.short(found.torque_nm),
            speed=words.short(found.speed_rpm),
            temperature=words.number(found.temperature_c, 1),
        ),
        **_lines(found.rows, found.expanded_nm, found.factor, "", words),
    }


def _lines(
    rows: Sequence[BudgetRow], expanded_nm: float, factor: float, freedom: str, words: Labels
) -> dict[str, Any]:
    return {
        "header": [words["quantity"], words["distribution"], "u / N·m", "ν", words["share"]],
        "rows": [
            [
                words.said(line.name),
                words.said(line.distribution),
                words.uncertainty(line.standard_uncertainty_nm),
                _freedom(line.degrees_of_freedom, words),
                f"{words.number(100.0 * line.share, 1)} %",
            ]
            for line in rows
        ],
        "total": [
            words["budget_total"],
            f"k = {words.number(factor, 2)}; U = {words.uncertainty(expanded_nm)} N·m",
            words.uncertainty(expanded_nm / factor),
            freedom,
            f"{words.number(100.0, 0)} %",
        ],
    }


def _freedom(value: float | None, words: Labels) -> str:
    return "∞" if value is None else words.number(value, 0)


def _records(record: CertificateRecord, words: Labels) -> dict[str, Any]:
    return {
        "title": words["records"],
        "facts": [
            (words["run"], [f"{record.run_id} (calibration-{record.calibration_id})"]),
            (words["software"], [f"torquebench {record.software_version}"]),
        ],
        "hashes": [
            (words["record_hash"], record.sha256),
            *(
                (words["signed_hash"], signed)
                for signed in dict.fromkeys(act.covers_sha256 for act in record.acts)
                if signed
            ),
            (words["profile_hash"], record.method.sha256),
            (words["registry_head"], record.registry_head),
        ],
        "files_title": words["files"],
        "files": list(record.files.items()),
    }
