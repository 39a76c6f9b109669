"""The record that PDF and digital certificate are both written from: everything they state."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from datetime import date
from types import UnionType
from typing import Any, Self, Union, cast, get_args, get_origin, get_type_hints

from torquebench.errors import RecordError
from torquebench.records import json_text
from torquebench.uncertainty import Verdict

__all__ = [
    "PAYLOAD_PREFIX",
    "BudgetRow",
    "CertificateRecord",
    "Conformity",
    "DeviationStatement",
    "Item",
    "Method",
    "Party",
    "Reference",
    "ResultRow",
    "VerificationSummary",
]

PAYLOAD_PREFIX = "torquebench-certificate"
"""What the QR code begins with, before number and hash."""

RECORD_FORMAT = 1


@dataclass(frozen=True)
class Party:
    """A laboratory or a customer.

    Parameters
    ----------
    name : str
        Empty where nobody has stated one.
    street, post_code, city, country : str
        Its address; `country` is the two letters of ISO 3166-1.
    email : str
    """

    name: str = ""
    street: str = ""
    post_code: str = ""
    city: str = ""
    country: str = ""
    email: str = ""


@dataclass(frozen=True)
class Item:
    """What was calibrated: a transducer in its measuring chain.

    Parameters
    ----------
    serial, manufacturer, model : str
        Of the transducer.
    side : str
        ``"input"`` or ``"output"`` of the bench; empty elsewhere.
    bench, counter_identity : str
        The rest of the chain: where it is fitted, and which clock times it.
    range_nm : float
        Full scale in N·m.
    """

    serial: str
    manufacturer: str
    model: str
    side: str
    bench: str
    counter_identity: str
    range_nm: float


@dataclass(frozen=True)
class Method:
    """The profile that was followed, and whether somebody has checked it against its source."""

    name: str
    title: str
    source: str
    sha256: str
    verified: bool
    series: int
    points: int
    unsettled: int


@dataclass(frozen=True)
class Reference:
    """The standard that the chain was calibrated against, as its own certificate states it.

    Parameters
    ----------
    expanded_uncertainty_percent : float
        k = 2, in % of the range.
    performed, due : datetime.date or None
        Day of its calibration, and last day on which it counts; None where nobody has stated it.
    """

    serial: str
    model: str
    certificate_number: str
    laboratory: str
    expanded_uncertainty_percent: float
    performed: date | None = None
    due: date | None = None


@dataclass(frozen=True)
class ResultRow:
    """The result at one step of torque on one branch.

    Parameters
    ----------
    torque_nm : float
        Nominal torque of the step in N·m, clockwise positive. The zero that is returned to from
        counter-clockwise torque is -0.0.
    branch : int
        +1 increasing, -1 decreasing, 0 unknown.
    standard_nm : float
        Mean torque of the standard in N·m.
    readings : int
        How many series the mean is of.
    error_before_nm, error_after_nm : float
        Mean of indication minus standard, raw and compensated, in N·m.
    expanded_before_nm, expanded_after_nm : float
        Expanded uncertainty of the errors in N·m.
    factor_before, factor_after : float
        Coverage factors k.
    verdict : str
        Of the error after compensation, as `Verdict` has it.
    """

    torque_nm: float
    branch: int
    standard_nm: float
    readings: int
    error_before_nm: float
    expanded_before_nm: float
    factor_before: float
    error_after_nm: float
    expanded_after_nm: float
    factor_after: float
    verdict: Verdict


@dataclass(frozen=True)
class BudgetRow:
    """One contribution to the uncertainty of the error after compensation.

    Parameters
    ----------
    name : str
        Key of the contribution's label.
    distribution : str
    standard_uncertainty_nm : float
        In N·m; all sensitivity coefficients are 1.
    degrees_of_freedom : float or None
        None for infinitely many.
    share : float
        Part of the variance.
    """

    name: str
    distribution: str
    standard_uncertainty_nm: float
    degrees_of_freedom: float | None
    share: float


@dataclass(frozen=True)
class VerificationSummary:
    """What a verification at fresh points found, against the verification standard.

    Parameters
    ----------
    worst_before_nm, worst_after_nm : float
        Largest |error| of single readings in N·m.
    averaged_after_nm : float or None
        Largest |error| averaged over the groups.
    """

    performed: date
    points: int
    groups: int
    worst_before_nm: float
    worst_after_nm: float
    averaged_after_nm: float | None
    data_sha256: str


@dataclass(frozen=True)
class Conformity:
    """The statement of conformity with what it rests on.

    Parameters
    ----------
    tolerance_percent_fs : float
        Largest allowed |error| in % of full scale.
    verdict : str
        The worst of all steps.
    worst_error_nm, expanded_nm, at_nm : float
        Error, its expanded uncertainty and the torque of the step that decides.
    counts : mapping of str to int
        Number of steps by verdict.
    """

    tolerance_percent_fs: float
    verdict: Verdict
    worst_error_nm: float
    expanded_nm: float
    at_nm: float
    counts: Mapping[str, int]


@dataclass(frozen=True)
class DeviationStatement:
    """One departure from the profile that the certificate carries."""

    clause: str
    found: str
    allowed: str


@dataclass(frozen=True)
class CertificateRecord:
    """Everything that a certificate states; PDF and XML hold nothing beyond it.

    Parameters
    ----------
    number : str
        Unique number of the certificate.
    languages : tuple of str
        ``"en"``, ``"de"``, ``"zh"``: one PDF each, all of them in the XML; the first one leads.
    draft : bool
        Whether nobody has issued it, which every page then says.
    simulated : bool
        Whether the bench was simulated, which every page then says.
    calibrated_from, calibrated_to, issued : datetime.date
        First and last day of the calibration, and day of issue.
    temperature_c : tuple of float or None
        Lowest and highest temperature of the calibration in °C.
    compensation : str
        The model whose results are stated as "after compensation".
    results : tuple of ResultRow
        In rising order of torque, increasing before decreasing.
    budget, budget_step, budget_freedom
        The contributions at the step with the largest uncertainty, its place in `results`, and
        its effective degrees of freedom (None for infinitely many).
    measured_by, checked_by, authorised_by : tuple of str
        Who did it, who looked over it, who answers for it.
    files : mapping of str to str
        SHA-256 of the files that the certificate rests on.
    registry_head : str
        End of the registry's chain when the certificate was issued.
    supersedes : str
        Number of the certificate that this one replaces.
    """

    number: str
    languages: tuple[str, ...]
    draft: bool
    simulated: bool
    laboratory: Party
    customer: Party
    item: Item
    method: Method
    reference: Reference
    calibrated_from: date
    calibrated_to: date
    issued: date
    run_id: str
    calibration_id: int
    temperature_c: tuple[float, float] | None
    compensation: str
    results: tuple[ResultRow, ...]
    budget: tuple[BudgetRow, ...]
    budget_step: int
    budget_freedom: float | None
    conformity: Conformity
    verification: VerificationSummary | None
    deviations: tuple[DeviationStatement, ...]
    measured_by: str
    checked_by: str
    authorised_by: tuple[str, ...]
    software_version: str
    files: Mapping[str, str]
    registry_head: str
    supersedes: str = ""
    format: int = field(default=RECORD_FORMAT)

    @property
    def sha256(self) -> str:
        """SHA-256 of the record's content, which the QR code carries."""
        text = json.dumps(
            json.loads(json_text(self)), sort_keys=True, ensure_ascii=False, separators=(",", ":")
        )
        return hashlib.sha256(text.encode()).hexdigest()

    @property
    def payload(self) -> str:
        """Text of the QR code: what it is, its number and the hash of its record."""
        return f"{PAYLOAD_PREFIX};{self.number};{self.sha256}"

    def to_json(self) -> str:
        """Return the record as indented JSON, from which the same certificate is written again."""
        return json_text(self, indent=2) + "\n"

    @classmethod
    def from_json(cls, text: str) -> Self:
        """Return the record that `to_json` wrote.

        Raises
        ------
        RecordError
            Where the text isn't such a record.
        """
        try:
            record = _restored(cls, json.loads(text))
        except (ValueError, KeyError, TypeError) as error:
            raise RecordError(
                f"a certificate's record that can't be read ({error})",
                "a .json file written by `torquebench certificate`",
            ) from error
        assert isinstance(record, cls)
        return record


def _restored(kind: Any, value: Any) -> Any:
    """Return a value of JSON as the type that a field asks for."""
    if is_dataclass(kind):
        hints = get_type_hints(kind)
        names = [each.name for each in fields(kind)]
        return cast(Any, kind)(**{name: _restored(hints[name], value[name]) for name in names})
    origin, inner = get_origin(kind), get_args(kind)
    if origin in (Union, UnionType):
        return None if value is None else _restored(inner[0], value)
    if origin is tuple:
        return tuple(
            _restored(inner[0] if inner[-1] is Ellipsis else inner[place], item)
            for place, item in enumerate(value)
        )
    if kind is date:
        return date.fromisoformat(value)
    if kind is Verdict:
        return Verdict(value)
    if kind is float:
        return float(value)
    return value
