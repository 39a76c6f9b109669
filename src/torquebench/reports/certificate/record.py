"""The record that contains every statement of the PDF and the digital certificate."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import MISSING, dataclass, field, fields
from datetime import date, datetime
from typing import Any

from torquebench.bench.mounting_record import MOUNTING_WORDS
from torquebench.message import Message
from torquebench.records import json_text
from torquebench.records.files import with_messages
from torquebench.records.registry.entries import sha256_of_record
from torquebench.records.signatures import Signature
from torquebench.uncertainty import CertifiedUncertainty, Verdict

PAYLOAD_PREFIX = "torquebench-certificate"
"""Beginning of the QR code's text, before number and hash."""

RECORD_FORMAT = 4


def stated(label: str, default: Any = MISSING) -> Any:
    """Declare a field that every form of the certificate displays with a label.

    The PDF lists it among the facts, the digital certificate as a statement. Empty fields aren't
    displayed.
    """
    return field(default=default, metadata={"label": label})


@dataclass(frozen=True)
class Party:
    """A laboratory or a customer.

    Parameters
    ----------
    name : str
        Its name; empty if not stated.
    street, post_code, city, country : str
        Its address; `country` is the two-letter code of ISO 3166-1.
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
    """The calibrated item: a transducer in its measuring chain.

    Parameters
    ----------
    serial, manufacturer, model : str
        Data of the transducer.
    side : str
        ``"input"`` or ``"output"`` side of the bench; empty outside a bench.
    in_place : bool
        Whether it was calibrated in the bench where it is used.
    bench, counter_identity : str
        Bench that it is built into, and counter that measures its frequency.
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
    in_place: bool = True


@dataclass(frozen=True)
class Method:
    """The calibration profile, and whether it was checked against its source.

    `placement` describes the points of an adaptive calibration, `table` the file of an external
    calibration; both are empty for other calibrations.
    """

    name: str
    title: str
    source: str
    sha256: str
    verified: bool
    series: int
    points: int
    unsettled: int
    placement: tuple[int, int, int] | None = None
    table: str = stated("Points read from the table", default="")


@dataclass(frozen=True)
class Reference:
    """The reference standard of the calibration, as stated in its certificate.

    Parameters
    ----------
    expanded_uncertainty_percent : float
        Largest U (k = 2), % of the range; if `of_range` is false, % of each torque. If `certified`
        is given, that applies instead.
    performed, due : datetime.date or None
        Day of its calibration, and last day on which it is valid; None if not stated.
    certified : CertifiedUncertainty or None
        U as a function of torque, if its certificate contains a table.
    """

    serial: str
    model: str
    certificate_number: str
    laboratory: str
    expanded_uncertainty_percent: float
    performed: date | None = None
    due: date | None = None
    of_range: bool = True
    certified: CertifiedUncertainty | None = None

    @property
    def label(self) -> str:
        """Key of the label that states its uncertainty."""
        if self.certified is not None:
            return "reference_text_table"
        return "reference_text" if self.of_range else "reference_text_relative"

    def uncertainty(self, range_nm: float) -> CertifiedUncertainty:
        """Return U (k = 2) as a function of torque."""
        if self.certified is not None:
            return self.certified
        share = 1e-2 * self.expanded_uncertainty_percent
        return (
            CertifiedUncertainty.of_range(share, range_nm)
            if self.of_range
            else CertifiedUncertainty.of_torque(share)
        )


@dataclass(frozen=True)
class ResultRow:
    """The result at one step of torque on one branch.

    Parameters
    ----------
    torque_nm : float
        Nominal torque of the step in N·m, clockwise positive; -0.0 is the zero after
        counter-clockwise torque.
    branch : int
        +1 increasing, -1 decreasing, 0 unknown.
    standard_nm : float
        Mean torque of the standard in N·m.
    readings : int
        Number of series in the mean.
    error_before_nm, error_after_nm : float
        Mean of indication minus standard, raw and compensated, in N·m; all "after" fields are None
        without compensation.
    expanded_before_nm, expanded_after_nm : float
        Expanded uncertainty of the errors in N·m.
    factor_before, factor_after : float
        Coverage factors k.
    verdict : str or None
        `Verdict` of the compensated error (without compensation, of the raw error); None without a
        statement of conformity.
    """

    torque_nm: float
    branch: int
    standard_nm: float
    readings: int
    error_before_nm: float
    expanded_before_nm: float
    factor_before: float
    error_after_nm: float | None
    expanded_after_nm: float | None
    factor_after: float | None
    verdict: Verdict | None

    @property
    def judged(self) -> tuple[float, float, float]:
        """Error, expanded uncertainty and coverage factor that the certificate assesses."""
        if self.error_after_nm is None or self.expanded_after_nm is None:
            return self.error_before_nm, self.expanded_before_nm, self.factor_before
        assert self.factor_after is not None
        return self.error_after_nm, self.expanded_after_nm, self.factor_after


@dataclass(frozen=True)
class BudgetRow:
    """One contribution to the uncertainty of the assessed error.

    Parameters
    ----------
    name : str
    distribution : str
    standard_uncertainty_nm : float
        Standard uncertainty in N·m; all sensitivity coefficients are 1.
    degrees_of_freedom : float or None
        Degrees of freedom; None means infinite.
    share : float
        Share of the variance.
    """

    name: str
    distribution: str
    standard_uncertainty_nm: float
    degrees_of_freedom: float | None
    share: float


@dataclass(frozen=True)
class Conformity:
    """The statement of conformity and its basis.

    Parameters
    ----------
    tolerance_percent_fs : float
        Largest allowed |error| in % of full scale.
    verdict : str
        The worst verdict of all steps, or of all points of the verification.
    worst_error_nm, expanded_nm, at_nm : float
        Error, its expanded uncertainty and torque at the deciding step or point.
    counts : mapping of str to int
        Number of steps or points by verdict.
    fresh : bool
        Whether it is based on the verification's points.
    """

    tolerance_percent_fs: float
    verdict: Verdict
    worst_error_nm: float
    expanded_nm: float
    at_nm: float
    counts: Mapping[str, int]
    fresh: bool = False


@dataclass(frozen=True)
class TurningBudget:
    """Budget of the compensated torque at the ends of the measured range during rotation.

    Parameters
    ----------
    torque_nm, speed_rpm, temperature_c : float
        Operating point of the budget.
    rows : tuple of BudgetRow
    expanded_nm, factor : float
        U in N·m and its coverage factor.
    """

    torque_nm: float
    speed_rpm: float
    temperature_c: float
    rows: tuple[BudgetRow, ...]
    expanded_nm: float
    factor: float


@dataclass(frozen=True)
class VerificationSummary:
    """Results of a verification at fresh points, against the verification standard.

    Parameters
    ----------
    worst_before_nm, worst_after_nm : float
        Largest |error| of a single reading in N·m.
    averaged_after_nm : float or None
        Largest |error| after averaging over the groups, in N·m.
    conformity : Conformity or None
        Conformity of the verification's points; None without a tolerance or without a run.
    """

    performed: date
    points: int
    groups: int
    worst_before_nm: float
    worst_after_nm: float
    averaged_after_nm: float | None
    data_sha256: str
    conformity: Conformity | None = None


@dataclass(frozen=True)
class DeviationStatement:
    """One deviation from the profile that the certificate states."""

    clause: str
    found: str
    allowed: str

    def __str__(self) -> str:
        return Message(
            "{found}; allowed: {allowed} (clause {clause})", self.found, self.allowed, self.clause
        )


@dataclass(frozen=True)
class Act:
    """What a person did for the certificate, and how they were authenticated.

    Parameters
    ----------
    role : {"measured", "checked", "used", "authorised"}
    name : str
        The person's name.
    moment : datetime.datetime or None
        Time in UTC; None for the measurement, which has the calibration's dates.
    signature : Signature or None
        None before 0.3.0.
    covers_sha256 : str
        Hash of the calibration with its models and their verifications, if the signature covers
        them.
    password_set : tuple of (date, str)
        Days within the 30 days before on which somebody else set the account's password, and who.
    """

    role: str
    name: str
    moment: datetime | None
    signature: Signature | None
    covers_sha256: str = ""
    password_set: tuple[tuple[date, str], ...] = ()

    @property
    def signed(self) -> bool:
        """Whether the person gave their account's password for it."""
        return self.signature is not None and self.signature.signed


@dataclass(frozen=True)
class StaticRow:
    """The quantities of a static evaluation at one step, in % of the deflection; None if unknown.

    Parameters
    ----------
    torque_nm : float
        Magnitude of the step in N·m.
    indication, repeatability, reproducibility, interpolation, reversibility : float or None
        The quantities f_q, b′, b (as a range), f_a, h.
    expanded, interval : float or None
        Expanded uncertainty W (k = 2) of the interpolation, and W′ = |f_q| + W.
    """

    torque_nm: float
    indication: float | None
    repeatability: float | None
    reproducibility: float | None
    interpolation: float | None
    reversibility: float | None
    expanded: float
    interval: float | None


@dataclass(frozen=True)
class StaticClass:
    """A class whose limits are met from a torque (magnitude, N·m) up to the largest step."""

    accuracy_class: float
    from_nm: float


@dataclass(frozen=True)
class StaticTable:
    """The static evaluation of one direction, of the reading or of the compensated torque.

    Parameters
    ----------
    direction : int
        +1 clockwise, -1 counter-clockwise.
    compensated : bool
    rows : tuple of StaticRow
        In rising order of torque.
    degree : int
        Degree of the interpolation through zero.
    resolution_nm : float
        Resolution used in the evaluation, in N·m.
    zero_residual : float or None
        f₀ in % of the span.
    classes : tuple of StaticClass
        Each class with its largest range; a worse class is listed only if its range is larger.
    missing : tuple of str
        Symbols of the quantities that a class needs and that weren't measured.
    """

    direction: int
    compensated: bool
    rows: tuple[StaticRow, ...]
    degree: int
    resolution_nm: float
    zero_residual: float | None
    classes: tuple[StaticClass, ...]
    missing: tuple[str, ...]


@dataclass(frozen=True)
class ZeroHysteresisStatement:
    """Largest difference between the zeros after both directions, over a number of cycles."""

    cycles: int
    before_nm: float
    before_percent_fs: float
    after_nm: float | None
    after_percent_fs: float | None


@dataclass(frozen=True)
class CertificateRecord:
    """Everything that a certificate states; PDF and XML contain nothing else.

    Parameters
    ----------
    number : str
        Unique number of the certificate.
    languages : tuple of str
        ``"en"``, ``"de"``, ``"zh"``: one PDF per language, all in the XML; the first is
        authoritative.
    draft : bool
        Whether it is only a draft; every page then states this.
    simulated : bool
        Whether the bench was simulated; every page then states this.
    calibrated_from, calibrated_to, issued : datetime.date
        First and last day of the calibration, and day of issue.
    temperature_c : tuple of float or None
        Lowest and highest temperature of the calibration in °C.
    compensation : str
        The model of the results "after compensation"; empty without a model.
    results : tuple of ResultRow
        In rising order of torque, increasing before decreasing.
    budget, budget_step, budget_freedom
        Contributions at the step with the largest uncertainty, the step's index in `results`, and
        its effective degrees of freedom (None means infinite).
    conformity : Conformity or None
        None without a statement of conformity.
    static : tuple of StaticTable
        Static evaluation by direction, before and after compensation; empty where the steps don't
        allow it.
    zero_hysteresis : ZeroHysteresisStatement or None
        Zero hysteresis of reversing cycles.
    unreviewed : tuple of str
        Keys of `UNREVIEWED`: what no second person or fresh points confirmed; every page lists
        them.
    acts : tuple of Act
        Who measured, reviewed, activated and authorised, and how they were authenticated.
    turning : str
        Ranges of speed, temperature and acceleration in which effects were measured; empty without
        such measurements.
    turning_budget : TurningBudget or None
    measured_by, checked_by, authorised_by : tuple of str
        The persons who measured, reviewed and authorised.
    files : mapping of str to str
        SHA-256 of the files on which the certificate is based; `model_file` is the model's.
    registry_head : str
        End of the registry's chain when the certificate was issued.
    supersedes : str
        Number of the certificate that this one replaces.
    coaxiality, clamp_pressure, mounting_time, lubrication, mounted_by : str
        From the record of the mounting; empty if not entered.
    loading_accuracy : str
        Largest difference of the standard from the requested torque.
    readings : str
        Conversion of the readings to N·m; empty if they were in N·m.
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
    conformity: Conformity | None
    verification: VerificationSummary | None
    deviations: tuple[DeviationStatement, ...]
    measured_by: str
    checked_by: str
    authorised_by: tuple[str, ...]
    software_version: str
    files: Mapping[str, str]
    registry_head: str
    supersedes: str = ""
    static: tuple[StaticTable, ...] = ()
    zero_hysteresis: ZeroHysteresisStatement | None = None
    unreviewed: tuple[str, ...] = ()
    acts: tuple[Act, ...] = ()
    coaxiality: str = stated(MOUNTING_WORDS["coaxiality"], default="")
    clamp_pressure: str = stated(MOUNTING_WORDS["clamp_pressure"], default="")
    mounting_time: str = stated(MOUNTING_WORDS["mounting_time"], default="")
    lubrication: str = stated(MOUNTING_WORDS["lubrication"], default="")
    mounted_by: str = stated(MOUNTING_WORDS["mounted_by"], default="")
    loading_accuracy: str = stated("Loading accuracy", default="")
    readings: str = stated("Conversion of the readings", default="")
    turning: str = stated("During rotation, the compensation is valid for", default="")
    turning_budget: TurningBudget | None = None
    not_in_u: tuple[str, ...] = ()
    model_file: str = ""
    format: int = field(default=RECORD_FORMAT)

    @property
    def sha256(self) -> str:
        """SHA-256 of the record's content, as contained in the QR code."""
        return sha256_of_record(json.loads(json_text(with_messages(self))))

    def stated(self) -> Iterator[tuple[str, str]]:
        """Yield label and text of every field declared by `stated`."""
        for part in (self.item, self.method, self.reference, self):
            for each in fields(part):
                value = getattr(part, each.name)
                if "label" in each.metadata and value not in ("", None, ()):
                    yield each.metadata["label"], value if isinstance(value, str) else str(value)

    @property
    def payload(self) -> str:
        """Text of the QR code: prefix, number and hash of the record."""
        return f"{PAYLOAD_PREFIX};{self.number};{self.sha256}"

    def to_json(self) -> str:
        """Return the record as indented JSON."""
        return json_text(with_messages(self), indent=2) + "\n"
