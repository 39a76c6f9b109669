"""The bench as its `bench.toml` describes it, checked key by key before anything moves."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import date
from importlib import resources
from math import hypot, sqrt
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from torquebench.bench.certificates.torque import ReferenceCertificate, read_certificate
from torquebench.bench.roles import SIDES, Mounting, Side, Signal
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.signals import SignalScale
from torquebench.units import KHZ, RAD_S_PER_RPM, RPM_PER_RAD_S
from torquebench.validation import ConflictError, parse_toml, validated

if TYPE_CHECKING:
    from torquebench.uncertainty import CertifiedUncertainty

DEFAULT_BENCH = "simulated.toml"

Text = Annotated[str, Field(min_length=1, max_length=200)]
Torque = Annotated[float, Field(gt=0, le=1e6, description="N·m")]
Speed = Annotated[float, Field(gt=0, le=1e5, description="rpm")]
Sensitivity = Annotated[float, Field(gt=0, le=1e6, description="Hz/(N·m)")]
TemperatureC = Annotated[float, Field(ge=-40, le=200, description="°C")]


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


_GROUP_DELAY_S = {60: 220e-6, 240: 150e-6}


class TransducerDescription(_Section):
    """A torque transducer, or the amplifier behind it, with nominal data from its data sheet.

    `signal` is what its instrument states: a frequency, a torque ("Nm"), a voltage ("V") or a ratio
    ("mV/V"). `option_khz` is the frequency at zero torque: 60 (60 ± 30 kHz) or 240 (240 ± 120 kHz).
    Sensitivities that aren't given are the nominal ones: half the zero's frequency over the nominal
    torque. `signal_at_nominal` is the voltage or ratio at nominal torque, `signal_at_nominal_ccw`
    its magnitude counter-clockwise if different. `filter_delay_s` is the delay of the signal
    against the torque by the amplifier's filter, `signal_uncertainty_percent` the standard
    uncertainty of one value by resolution and noise.

    The limits of its data sheet are shares of the nominal torque, those of the span shares of the
    torque; zero drift, long-term drift and creep under load are unknown if they aren't given, and
    then U doesn't contain them.
    """

    serial: Text
    model: Text = "unknown"
    manufacturer: Text = "unknown"
    nominal_torque_nm: Torque
    signal: Signal = "frequency"
    option_khz: Literal[60, 240] = 60
    sensitivity_cw_hz_per_nm: Sensitivity | None = None
    sensitivity_ccw_hz_per_nm: Sensitivity | None = None
    signal_at_nominal: Annotated[float, Field(gt=0, le=1e3, description="V or mV/V")] | None = None
    signal_at_nominal_ccw: Annotated[float, Field(gt=0, le=1e3, description="V or mV/V")] | None = (
        None
    )
    filter_delay_s: Annotated[float, Field(ge=0, le=10, description="s")] | None = None
    signal_uncertainty_percent: (
        Annotated[float, Field(ge=0, le=1, description="% of nominal torque")] | None
    ) = None
    temperature_zero_percent_per_10k: Annotated[float, Field(ge=0, le=10, description="%")] = 0.1
    temperature_span_percent_per_10k: Annotated[float, Field(ge=0, le=10, description="%")] = 0.1
    speed_zero_percent_per_1000rpm: Annotated[float, Field(ge=0, le=10, description="%")] = 0.01
    zero_drift_percent_per_h: Annotated[float, Field(ge=0, le=10, description="%")] | None = None
    drift_percent_per_year: Annotated[float, Field(ge=0, le=10, description="%")] | None = None
    creep_percent: Annotated[float, Field(ge=0, le=10, description="%")] | None = None

    @property
    def nominal_sensitivity_hz_per_nm(self) -> float:
        """Sensitivity from the option and the nominal torque, Hz/(N·m)."""
        return self.option_khz * 500.0 / self.nominal_torque_nm

    @property
    def signal_text(self) -> str:
        """Signal at nominal torque, as text."""
        if self.signal == "frequency":
            return f"{self.option_khz} kHz"
        return "N·m" if self.signal == "Nm" else f"{self.signal_at_nominal:g} {self.signal}"

    @property
    def zero_hz(self) -> float:
        """Nominal frequency at zero torque, Hz."""
        return KHZ * self.option_khz

    @property
    def modulation_hz(self) -> tuple[float, float]:
        """Lowest and highest frequency of a working transducer, Hz."""
        return 0.25 * self.zero_hz, 1.75 * self.zero_hz

    @property
    def nominal_sensitivity(self) -> float:
        """Nominal signal per N·m, in the unit of the signal."""
        if self.signal == "frequency":
            return self.nominal_sensitivity_hz_per_nm
        return self.scale().sensitivity_cw

    @property
    def group_delay_s(self) -> float:
        """Delay of the signal against the torque, s."""
        if self.filter_delay_s is not None:
            return self.filter_delay_s
        return _GROUP_DELAY_S[self.option_khz] if self.signal == "frequency" else 0.0

    @property
    def signal_uncertainty_nm(self) -> float:
        """Standard uncertainty of one value from an amplifier, N·m."""
        return 1e-2 * (self.signal_uncertainty_percent or 0.0) * self.nominal_torque_nm

    def stated(self) -> Self:
        """Return the transducer as its read-out delivers it: in N·m unless described otherwise."""
        if self.signal != "frequency":
            return self
        return self.model_copy(update={"signal": "Nm", "filter_delay_s": 0.0})

    @model_validator(mode="after")
    def _plausible(self) -> Self:
        """Refuse sensitivities that are far from the nominal one."""
        nominal = self.nominal_sensitivity_hz_per_nm
        for key in ("sensitivity_cw_hz_per_nm", "sensitivity_ccw_hz_per_nm"):
            value = getattr(self, key)
            if value is not None and abs(value / nominal - 1.0) > 0.05:
                raise ConflictError(
                    key,
                    Message("{value:g} Hz/(N·m)", value),
                    Message(
                        "{lowest:g} to {highest:g} Hz/(N·m), within 5 % of nominal",
                        0.95 * nominal,
                        1.05 * nominal,
                    ),
                    "check nominal_torque_nm, option_khz and the certificate",
                )
        return self

    @model_validator(mode="after")
    def _keys_of_its_signal(self) -> Self:
        """Refuse keys that the kind of signal doesn't have, and the lack of those it needs."""
        ratio = {"signal_at_nominal", "signal_at_nominal_ccw"}
        amplifier = {"filter_delay_s", "signal_uncertainty_percent"}
        required = set() if self.signal == "frequency" else set(amplifier)
        foreign = set(ratio)
        if self.signal in ("V", "mV/V"):
            required.add("signal_at_nominal")
            foreign = set()
        if self.signal == "frequency":
            foreign.add("signal_uncertainty_percent")
        else:
            foreign |= {"option_khz", "sensitivity_cw_hz_per_nm", "sensitivity_ccw_hz_per_nm"}
        for key in sorted(required):
            if getattr(self, key) is None:
                raise ConflictError(
                    key,
                    "missing",
                    Message("a value for signal = {signal!r}", self.signal),
                    "take it from the amplifier's data sheet or settings",
                )
        defaults = {key: type(self).model_fields[key].default for key in foreign}
        for key in sorted(key for key in foreign if getattr(self, key) != defaults[key]):
            raise ConflictError(
                key,
                repr(getattr(self, key)),
                Message("no such key for signal = {signal!r}", self.signal),
                "remove it, or correct the signal",
            )
        return self

    def scale(self) -> SignalScale:
        """Scale of this transducer with its nominal zero, for use before a zero is measured."""
        if self.signal == "frequency":
            nominal = self.nominal_sensitivity_hz_per_nm
            return SignalScale(
                nominal_torque_nm=self.nominal_torque_nm,
                nominal_zero=self.zero_hz,
                sensitivity_cw=self.sensitivity_cw_hz_per_nm or nominal,
                sensitivity_ccw=self.sensitivity_ccw_hz_per_nm or nominal,
                limits=self.modulation_hz,
            )
        full = self.signal_at_nominal or self.nominal_torque_nm
        highest = 1.5 * max(full, self.signal_at_nominal_ccw or 0.0)
        return SignalScale(
            nominal_torque_nm=self.nominal_torque_nm,
            nominal_zero=0.0,
            sensitivity_cw=full / self.nominal_torque_nm,
            sensitivity_ccw=(self.signal_at_nominal_ccw or full) / self.nominal_torque_nm,
            limits=(-highest, highest),
            unit=self.signal.replace("Nm", "N·m"),
        )


class DriveDescription(_Section):
    """A servo drive, and the rates of torque and speed at the module's shaft.

    `gear_ratio` is the number of motor turns per turn of the shaft, negative if the gear reverses.
    The drive doesn't know the gear's losses: the shaft's torque is that of the transducer.
    """

    serial: Text
    model: Text = "unknown"
    torque_rate_nm_per_s: Annotated[float, Field(gt=0, le=1e7, description="N·m/s")]
    speed_rate_rpm_per_s: Annotated[float, Field(gt=0, le=1e6, description="rpm/s")]
    watchdog_s: Annotated[float, Field(ge=0.1, le=10.0, description="s")] = 0.5
    gear_ratio: Annotated[float, Field(ge=-1e4, le=1e4, description="motor turns a shaft turn")] = 1

    @model_validator(mode="after")
    def _turns(self) -> Self:
        """Refuse a gear ratio of about zero."""
        if abs(self.gear_ratio) < 1e-3:
            raise ConflictError(
                "gear_ratio",
                Message("{ratio:g} motor turns a shaft turn", self.gear_ratio),
                "at least 0.001, or at most -0.001",
                "give the gear's ratio; 1 without one",
            )
        return self

    @property
    def speed_rate_rad_per_s2(self) -> float:
        """Rate of the speed, rad/s²."""
        return self.speed_rate_rpm_per_s * RAD_S_PER_RPM

    def rate(self, quantity: Literal["torque", "speed"]) -> float:
        """Return the rate of a quantity, N·m/s or rad/s²."""
        return self.torque_rate_nm_per_s if quantity == "torque" else self.speed_rate_rad_per_s2


class EncoderDescription(_Section):
    """An angle encoder; its counts are those after interpolation.

    `accuracy_arcsec` is the largest error (±) over a turn by its data sheet; unknown if it isn't
    given. `certificate` may name a CSV file beside the `bench.toml` with the columns `angle_deg`,
    `error_arcsec` and `expanded_uncertainty_arcsec` (k = 2); its errors are then corrected.
    `absolute` states that its counts begin at the same mark on the shaft whenever the bench is
    opened, so that effects that repeat with every turn can be corrected.
    """

    serial: Text
    counts_per_revolution: Annotated[int, Field(ge=16, le=2**31, description="counts")]
    accuracy_arcsec: Annotated[float, Field(ge=0, le=36000, description="arcsec")] | None = None
    certificate: str | None = None
    absolute: bool = False


class GuideRailDescription(_Section):
    """The rail that carries the input module: moved away for mounting, to its end for measuring.

    With a section `[driver.guide_rail]` it is moved and monitored; without one it is moved by hand.
    """

    serial: Text
    model: Text = "unknown"
    travel_mm: Annotated[float, Field(gt=0, le=1e5, description="mm")] | None = None


class PowerSupplyDescription(_Section):
    """The drives' power supply; with a section `[driver.power_supply]` its contact is monitored."""

    serial: Text
    model: Text = "unknown"
    voltage_v: Annotated[float, Field(gt=0, le=1e5, description="V")] | None = None
    power_kw: Annotated[float, Field(gt=0, le=1e4, description="kW")] | None = None


class LimitsDescription(_Section):
    """Absolute limits of one side, enforced by the supervisor.

    `angle_deg` is the largest angle from the position at which the drive was switched on; rates are
    the largest changes of torque and speed. Limits that aren't given aren't monitored.
    """

    torque_nm: Torque
    speed_rpm: Speed
    temperature_c: TemperatureC = 60.0
    angle_deg: Annotated[float, Field(gt=0, le=1e9, description="°")] | None = None
    torque_rate_nm_per_s: Annotated[float, Field(gt=0, le=1e9, description="N·m/s")] | None = None
    speed_rate_rpm_per_s: Annotated[float, Field(gt=0, le=1e9, description="rpm/s")] | None = None


class ModuleDescription(_Section):
    """One module: range, transducer, drive, encoder, limits and the transducer's probe.

    A module without `encoder` is loaded at rest only: its speed and angle aren't monitored, its
    drive takes no speed, and what needs an angle refuses it.

    `flange_inertia_kgm2` is the moment of inertia of the rotating parts between the transducer's
    measuring section and the reducer, with its expanded uncertainty (k = 2) as a share: the torque
    that accelerates it is subtracted. Unknown if it isn't given. `motor_inertia_kgm2` is that of
    motor, coupling and shaft up to the measuring section, by their data sheets: the dynamics by
    steps of torque need it. `bearing_drag_percent` is the limit of the drag of bearings between
    transducer and flange.
    """

    range_nm: Torque
    transducer: TransducerDescription
    drive: DriveDescription
    encoder: EncoderDescription | None = None
    limits: LimitsDescription
    temperature_probe: Text
    flange_inertia_kgm2: Annotated[float, Field(gt=0, le=1e4, description="kg·m²")] | None = None
    flange_inertia_uncertainty_percent: Annotated[float, Field(ge=0, le=100, description="%")] = 10
    motor_inertia_kgm2: Annotated[float, Field(gt=0, le=1e4, description="kg·m²")] | None = None
    motor_inertia_uncertainty_percent: Annotated[float, Field(ge=0, le=100, description="%")] = 6
    bearing_drag_percent: Annotated[float, Field(ge=0, le=10, description="% of range")] = 0.01

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        """Refuse a range or a torque limit that the transducer can't have."""
        nominal = self.transducer.nominal_torque_nm
        if self.range_nm > nominal:
            raise ConflictError(
                "range_nm",
                Message("{range_nm:g} N·m", self.range_nm),
                Message("at most the transducer's nominal {nominal:g} N·m", nominal),
                "set range_nm to the range that is used",
            )
        if not self.range_nm <= self.limits.torque_nm <= 1.5 * nominal:
            raise ConflictError(
                "limits.torque_nm",
                Message("{torque_nm:g} N·m", self.limits.torque_nm),
                Message(
                    "{low:g} N·m (the range) to {high:g} N·m (1.5 times the transducer's "
                    "nominal torque)",
                    self.range_nm,
                    1.5 * nominal,
                ),
                "set the limit a little above the range",
            )
        return self


class CounterDescription(_Section):
    """The counters' common clock and how frequency is counted."""

    serial: Text
    clock: Text
    timebase_hz: Annotated[float, Field(ge=1e6, le=1e9, description="Hz")] = 100e6
    method: Literal["reciprocal", "regression", "triangular"] = "regression"
    window_s: Annotated[float, Field(ge=0.001, le=1.0, description="s")] = 0.01
    block_s: Annotated[float, Field(ge=0.005, le=1.0, description="s")] = 0.05
    edge_jitter_s: Annotated[float, Field(ge=0, le=1e-6, description="s")] = 5e-9

    @property
    def identity(self) -> str:
        """The counter and its clock: calibration and measurement must use the same ones."""
        return f"{self.serial}/{self.clock}"

    def with_blocks(self, block_s: float) -> Self:
        """Return the counter with blocks of this duration, cut to whole windows, at least one."""
        windows = max(1, int(block_s / self.window_s + 1e-9))
        return self.model_copy(update={"block_s": windows * self.window_s})

    @model_validator(mode="after")
    def _whole_windows(self) -> Self:
        """Refuse a block that doesn't consist of whole windows."""
        ratio = self.block_s / self.window_s
        if ratio < 1.0 or abs(ratio - round(ratio)) > 1e-9:
            raise ConflictError(
                "block_s",
                Message("{block_s:g} s", self.block_s),
                Message("a multiple of window_s = {window_s:g} s", self.window_s),
                "set block_s to a whole number of windows",
            )
        return self


class CertifiedPoints(_Section):
    """Expanded uncertainty (k = 2) of a reference transducer at its certified torques."""

    torque_nm: list[float]
    expanded_uncertainty_nm: list[float]

    @model_validator(mode="after")
    def _usable(self) -> Self:
        self.certified()
        return self

    def certified(self) -> CertifiedUncertainty:
        """Return the certified uncertainty over the torque."""
        from torquebench.uncertainty import CertifiedUncertainty  # heavy

        return CertifiedUncertainty.of_table(self.torque_nm, self.expanded_uncertainty_nm)


class StandardDescription(_Section):
    """A calibrator or verification standard: two reference transducers and their certificate.

    `certificate` may name a CSV file beside the `bench.toml` with the columns `side`, `torque_nm`,
    `error_nm` and `expanded_uncertainty_nm` (k = 2). `certificate_due` is the last day on which the
    certificate is valid.

    The uncertainty over the torque is that of `certified`, which comes from `certificate` or is
    given for each side. Without it, U is `expanded_uncertainty_percent`, either of the transducer's
    nominal torque (at every torque) or of each torque. `certificate_temperature_c` is the
    temperature at which the standard was calibrated, `temperature_probe` the probe that it carries.
    """

    serial: Text
    model: Text = "unknown"
    certificate_number: Text
    certificate_date: Text = "unknown"
    certificate_due: date | None = None
    laboratory: Annotated[str, Field(max_length=200)] = ""
    certificate: str | None = None
    certificate_temperature_c: TemperatureC = 23.0
    temperature_probe: Text | None = None
    expanded_uncertainty_percent: Annotated[float, Field(gt=0, le=1.0, description="%")]
    expanded_uncertainty_of: Literal["range", "torque"] = "range"
    certified: dict[Side, CertifiedPoints] = Field(default_factory=dict)
    input: TransducerDescription
    output: TransducerDescription

    def transducer(self, side: Side) -> TransducerDescription:
        """Return the reference transducer of a side."""
        return self.input if side == "input" else self.output

    def uncertainty(self, side: Side) -> CertifiedUncertainty:
        """Return U (k = 2) over the torque for the reference transducer of a side."""
        return stated_uncertainty(self.model_dump(), side, self.transducer(side).nominal_torque_nm)

    def certified_by(self, certificates: Mapping[Side, ReferenceCertificate]) -> Self:
        """Return the standard with U from certificates for sides that don't have it yet."""
        stated = {
            side: CertifiedPoints(
                torque_nm=list(certificate.certified.torque_nm),
                expanded_uncertainty_nm=list(certificate.certified.expanded_nm),
            )
            for side, certificate in certificates.items()
        }
        return self.model_copy(update={"certified": {**stated, **self.certified}})


def stated_uncertainty(
    standard: Mapping[str, Any], side: str, range_nm: float
) -> CertifiedUncertainty:
    """Return U (k = 2) over the torque from a run's record of a standard.

    Parameters
    ----------
    standard : mapping
        Fields of a `StandardDescription`; some may be missing.
    side : str
        "input", "output", or "" if unknown.
    range_nm : float
        Nominal torque of the transducer, if the record doesn't state it.
    """
    points = (standard.get("certified") or {}).get(side)
    if points:
        return CertifiedPoints.model_validate(points).certified()
    from torquebench.uncertainty import CertifiedUncertainty

    share = 1e-2 * float(standard["expanded_uncertainty_percent"])
    if standard.get("expanded_uncertainty_of") == "torque":
        return CertifiedUncertainty.of_torque(share)
    nominal_nm = (standard.get(side) or {}).get("nominal_torque_nm", range_nm)
    return CertifiedUncertainty.of_range(share, nominal_nm)


class SafetyDescription(_Section):
    """Settings of the supervisor.

    `fast_check_s` is the interval of the signals' fast checks in real time. A warning is raised at
    `warning_percent` of a limit, and a level ends `hysteresis_percent` of the limit below it. With
    `presence_s` a drive has power only if the operator's presence was confirmed within that time; 0
    requires no confirmation. `procedure_s` is the longest time between two messages of a procedure
    that doesn't wait for the bench or for a person. A module and the standard on its side may
    differ by `disagreement_percent` while a drive has power. A drive may deviate from its commands
    of the last `following_s` by `following_percent`; 0 switches the comparison off.
    """

    fast_check_s: Annotated[float, Field(ge=0.002, le=1.0, description="s")] = 0.005
    warning_percent: Annotated[float, Field(gt=0, le=100.0, description="% of limit")] = 95.0
    hysteresis_percent: Annotated[float, Field(ge=0, le=50.0, description="% of limit")] = 2.0
    presence_s: Annotated[float, Field(ge=0.0, le=3600.0, description="s")] = 0.0
    procedure_s: Annotated[float, Field(ge=1.0, le=3600.0, description="s")] = 60.0
    disagreement_percent: Annotated[float, Field(gt=0, le=100.0, description="% of range")] = 5.0
    following_percent: Annotated[float, Field(ge=0, le=100.0, description="% of range")] = 10.0
    following_s: Annotated[float, Field(ge=0.1, le=60.0, description="s")] = 0.5
    ramp_to_zero_s: Annotated[float, Field(ge=0.0, le=5.0, description="s")] = 0.2
    signal_loss_s: Annotated[float, Field(ge=0.0, le=5.0, description="s")] = 0.03
    stuck_s: Annotated[float, Field(ge=0.05, le=60.0, description="s")] = 0.25
    stall_s: Annotated[float, Field(ge=0.2, le=60.0, description="s")] = 2.0
    unloaded_percent: Annotated[float, Field(gt=0, le=10.0, description="% of range")] = 1.0
    standstill_rpm: Annotated[float, Field(gt=0, le=100.0, description="rpm")] = 0.5

    def at_standstill(self, speed_rad_s: float) -> bool:
        """Return whether a side is at standstill; at an unknown speed it isn't."""
        return abs(speed_rad_s) * RPM_PER_RAD_S <= self.standstill_rpm


class RecordingDescription(_Section):
    """Data that are recorded beside a run's samples; with `edges` every edge of every channel.

    An hour of four transducers with 60 kHz takes about 0.3 GB. With `reducer_tests`, all inputs of
    a reducer test's evaluation are stored, so that a later version can evaluate it again.
    """

    edges: bool = False
    reducer_tests: bool = True


class ConditionsDescription(_Section):
    """Limits of the bench's conditions, which are used if a condition isn't measured.

    A zero is taken again at least every `zero_interval_h`, a calibration every
    `calibration_interval_days`; transducers stay between the two temperatures.
    """

    temperature_low_c: Annotated[float, Field(ge=-40, le=120, description="°C")] = 18.0
    temperature_high_c: Annotated[float, Field(ge=-40, le=120, description="°C")] = 28.0
    zero_interval_h: Annotated[float, Field(gt=0, le=1e5, description="h")] = 1.0
    calibration_interval_days: Annotated[float, Field(gt=0, le=1e5, description="days")] = 365.0

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        """Refuse a lowest temperature that isn't below the highest."""
        if self.temperature_low_c >= self.temperature_high_c:
            raise ConflictError(
                "temperature_low_c",
                Message("{temperature_low_c:g} °C", self.temperature_low_c),
                Message(
                    "below temperature_high_c = {temperature_high_c:g} °C", self.temperature_high_c
                ),
                "give the lowest and the highest temperature of the transducers",
            )
        return self


class _BenchSection(_Section):
    name: Text
    driver: Text = "simulated"
    reducer_ratio: Annotated[
        float, Field(gt=0, le=1e4, description="input turns per output turn")
    ] = 80.0


class BenchDescription(_Section):
    """Description of a bench, read before the bench is opened."""

    bench: _BenchSection
    driver: Mapping[str, Any] = Field(default_factory=dict)
    counter: CounterDescription
    input: ModuleDescription
    output: ModuleDescription
    calibrator: StandardDescription
    verification_standard: StandardDescription
    temperatures: tuple[Text, ...] = Field(min_length=1)
    safety: SafetyDescription = SafetyDescription()
    recording: RecordingDescription = RecordingDescription()
    conditions: ConditionsDescription = ConditionsDescription()
    guide_rail: GuideRailDescription | None = None
    power_supply: PowerSupplyDescription | None = None

    def counter_nm(self, side: Side) -> float:
        """Return the standard uncertainty of one window due to counting, N·m (arXiv:1506.05009).

        For an amplifier, return the standard uncertainty of one value.
        """
        transducer, counter = self.module(side).transducer, self.counter
        if transducer.signal != "frequency":
            return transducer.signal_uncertainty_nm
        edge_s = hypot(counter.edge_jitter_s, 1.0 / (counter.timebase_hz * sqrt(12.0)))
        edges = transducer.zero_hz * counter.window_s
        relative = sqrt(12.0 / edges) * edge_s / counter.window_s
        if counter.method == "reciprocal":
            relative = sqrt(2.0) * edge_s / counter.window_s
        return relative * KHZ * transducer.option_khz / transducer.nominal_sensitivity_hz_per_nm

    @property
    def name(self) -> str:
        """Name of the bench."""
        return self.bench.name

    @property
    def simulated(self) -> bool:
        """Whether results of this bench must be labelled simulated."""
        return self.bench.driver == "simulated" or "simulation" in self.driver

    @property
    def simulation(self) -> Mapping[str, Any]:
        """Settings of the simulation, such as seed and preset; empty for real instruments."""
        own = self.driver if self.bench.driver == "simulated" else self.driver.get("simulation")
        return dict(own or {})

    def module(self, side: Side) -> ModuleDescription:
        """Return the description of a side's module."""
        return self.input if side == "input" else self.output

    def needed_encoder(self, side: Side) -> EncoderDescription:
        """Return a module's encoder.

        Raises
        ------
        InputError
            The module has none.
        """
        encoder = self.module(side).encoder
        if encoder is None:
            raise InputError(
                Message("{bench}: the {side} module has no encoder", self.name, side),
                "an encoder, because this needs angle and speed",
                Message("describe it in [{side}.encoder], or do only what is done at rest", side),
            )
        return encoder

    def unloaded_nm(self, side: Side) -> float:
        """Return the largest torque at which a side counts as unloaded, N·m."""
        return self.safety.unloaded_percent / 100.0 * self.module(side).range_nm

    def standard(self, mounting: Mounting) -> StandardDescription | None:
        """Calibrator or verification standard of a mounting; None for other mountings."""
        if mounting == "calibrator":
            return self.calibrator
        return self.verification_standard if mounting == "verification_standard" else None

    def relative_to(self, folder: Path) -> Self:
        """Make the names of certificate files relative to the folder of the `bench.toml`."""
        changed: dict[str, _Section] = {}
        for name in ("calibrator", "verification_standard"):
            standard: StandardDescription = getattr(self, name)
            if standard.certificate is not None:
                path = str((folder / standard.certificate).resolve())
                changed[name] = standard.model_copy(update={"certificate": path})
        for side in SIDES:
            module = self.module(side)
            if module.encoder is not None and module.encoder.certificate is not None:
                path = str((folder / module.encoder.certificate).resolve())
                encoder = module.encoder.model_copy(update={"certificate": path})
                changed[side] = module.model_copy(update={"encoder": encoder})
        return self.model_copy(update=changed)

    def certified_by(self, brought: Mapping[Mounting, Mapping[Side, ReferenceCertificate]]) -> Self:
        """Return the description with the uncertainties from the certificates of standards.

        Parameters
        ----------
        brought : mapping
            Certificates that come with the instruments; a file in the description takes precedence.

        Raises
        ------
        InputError
            A certificate can't be read.
        """
        changed: dict[str, StandardDescription] = {}
        for name in ("calibrator", "verification_standard"):
            standard: StandardDescription = getattr(self, name)
            known = brought.get(name, {})
            if standard.certificate is not None:
                known = read_certificate(standard.certificate)
            if known:
                changed[name] = standard.certified_by(known)
        return self.model_copy(update=changed)

    @property
    def serials(self) -> dict[str, str]:
        """Every serial number by its key."""
        serials_by_role: dict[str, str] = {"counter": self.counter.serial}
        for name, part in (("guide_rail", self.guide_rail), ("power_supply", self.power_supply)):
            if part is not None:
                serials_by_role[name] = part.serial
        for side in ("input", "output"):
            module: ModuleDescription = getattr(self, side)
            serials_by_role[f"{side}.transducer"] = module.transducer.serial
            serials_by_role[f"{side}.drive"] = module.drive.serial
            if module.encoder is not None:
                serials_by_role[f"{side}.encoder"] = module.encoder.serial
        for name in ("calibrator", "verification_standard"):
            standard: StandardDescription = getattr(self, name)
            serials_by_role[name] = standard.serial
            serials_by_role[f"{name}.input"] = standard.input.serial
            serials_by_role[f"{name}.output"] = standard.output.serial
        return serials_by_role

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        """Refuse duplicate serial numbers, unknown probes and standards that are too small."""
        self._check_serials()
        for side in ("input", "output"):
            module: ModuleDescription = getattr(self, side)
            self._check_probe(f"{side}.temperature_probe", module.temperature_probe)
            for name in ("calibrator", "verification_standard"):
                standard: StandardDescription = getattr(self, name)
                self._check_probe(f"{name}.temperature_probe", standard.temperature_probe)
                nominal = standard.transducer(side).nominal_torque_nm
                if nominal < module.range_nm:
                    raise ConflictError(
                        f"{name}.{side}.nominal_torque_nm",
                        Message("{nominal:g} N·m", nominal),
                        Message("at least the module's range, {range:g} N·m", module.range_nm),
                        "use a standard that covers the range, or lower the range",
                    )
        return self

    def _check_probe(self, key: str, probe: str | None) -> None:
        """Refuse a temperature probe that the description doesn't list."""
        if probe is not None and probe not in self.temperatures:
            raise ConflictError(
                key,
                repr(probe),
                Message("one of {list}", ", ".join(self.temperatures)),
                "name a probe of the list `temperatures`",
            )

    def _check_serials(self) -> None:
        """Refuse a serial number that two transducers or modules share."""
        holders: dict[str, str] = {}
        for key, serial in self.serials.items():
            role = key.partition(".")[2] or key
            if "transducer" not in key and role not in ("input", "output"):
                continue
            if serial in holders:
                raise ConflictError(
                    f"{key}.serial",
                    repr(serial),
                    Message("a unique serial number ({holders} has this one)", holders[serial]),
                    "a calibration belongs to one transducer: read its name plate",
                )
            holders[serial] = key


def parse_bench(text: str, source: str = "bench.toml") -> BenchDescription:
    """Read a bench description from the text of a TOML file.

    Parameters
    ----------
    text : str
        The file's text.
    source : str
        Name of the file in messages.

    Raises
    ------
    InputError
        The description is invalid; the message states file, key, value, what is allowed and what to
        do.

    Examples
    --------
    >>> parse_bench("[bench]", "mine.toml")
    Traceback (most recent call last):
    ...
    torquebench.errors.InputError: mine.toml: bench.name is missing; add the key; also wrong: ...
    """
    return validated(BenchDescription, parse_toml(text, source), source)


def load_bench(path: Path | str) -> BenchDescription:
    """Read a bench description from a file; raises `InputError` like `parse_bench`."""
    file = Path(path)
    try:
        text = file.read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(
            Message("{file}: {strerror}", file, error.strerror or error),
            "a readable bench.toml",
            "give the path of a bench description, or none for the simulated bench",
        ) from error
    except UnicodeDecodeError as error:
        raise InputError(
            Message("{file}: not UTF-8 at byte {start}", file, error.start),
            "UTF-8 text",
            "save the file as UTF-8",
        ) from error
    return parse_bench(text, str(file)).relative_to(file.parent)


def default_bench() -> BenchDescription:
    """Describe the packaged simulated bench.

    Examples
    --------
    >>> default_bench().output.range_nm
    2000.0
    """
    text = (resources.files("torquebench.bench") / DEFAULT_BENCH).read_text(encoding="utf-8")
    return parse_bench(text, DEFAULT_BENCH)
