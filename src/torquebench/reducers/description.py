"""Descriptions of reducers: ratio, ratings and the limits of the data sheet, as TOML files."""

from importlib import resources
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.validation import parse_toml, validated

Positive = Annotated[float, Field(gt=0)]
RuleName = Literal["nabtesco", "spinea", "harmonic-drive", "yaskawa"]


class _Settings(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class NoLoadLimit(_Settings):
    """Largest no-load running torque at an input speed.

    Attributes
    ----------
    speed_rpm : float
        Input speed, 1/min; holds for both directions.
    torque_nm : float
        Largest magnitude of the torque at the input, N·m.
    """

    speed_rpm: Positive
    torque_nm: Positive


class CertifiedFriction(_Settings):
    """No-load torque of a standard reducer at one speed, as its certificate states it.

    Attributes
    ----------
    speed_rpm : float
        Input speed, 1/min; holds for both directions.
    torque_nm : float
        Magnitude of the torque at the input, output free, N·m.
    expanded_uncertainty_nm : float
        U (k = 2), N·m.
    """

    speed_rpm: Positive
    torque_nm: Positive
    expanded_uncertainty_nm: Annotated[float, Field(ge=0)]


class EfficiencyLimit(_Settings):
    """Smallest efficiency at an output torque and an input speed.

    Attributes
    ----------
    torque_nm : float
        Torque at the output, N·m.
    speed_rpm : float
        Speed at the input, 1/min.
    percent : float
        Smallest efficiency when the input drives, %.
    """

    torque_nm: Positive
    speed_rpm: Positive
    percent: Annotated[float, Field(gt=0, lt=100)]


class DataSheetLimits(_Settings):
    """Limits of a data sheet; each is optional.

    Attributes
    ----------
    stiffness_nm_per_arcmin : float or None
        Smallest torsional stiffness over the stiffness interval, N·m/arcmin.
    backlash_arcmin, lost_motion_arcmin : float or None
        Largest backlash and lost motion, arcmin.
    hysteresis_loss_j : float or None
        Largest loop energy of a cycle to the rated torque, J.
    no_load : tuple of NoLoadLimit
        Largest no-load running torques.
    starting_torque_nm, back_driving_torque_nm : float or None
        Largest starting torque at the input and back-driving torque at the output, N·m.
    transmission_error_arcsec : float or None
        Largest peak-to-peak transmission error over an output revolution, arcsec.
    efficiency : tuple of EfficiencyLimit
        Smallest efficiencies.
    """

    stiffness_nm_per_arcmin: Positive | None = None
    backlash_arcmin: Positive | None = None
    lost_motion_arcmin: Positive | None = None
    hysteresis_loss_j: Positive | None = None
    no_load: tuple[NoLoadLimit, ...] = ()
    starting_torque_nm: Positive | None = None
    back_driving_torque_nm: Positive | None = None
    transmission_error_arcsec: Positive | None = None
    efficiency: tuple[EfficiencyLimit, ...] = ()


class ReducerDescription(_Settings):
    """A type of reducer: data for its tests and limits for verdicts.

    Attributes
    ----------
    name : str
        Name of the type, such as "RV-40E class".
    kind : {"rv", "cycloidal", "harmonic", "other"}
    maker, source : str
        Maker of the reducer, and source of the numbers.
    ratio : float
        Input turns for one output turn, above 0.
    reversed : bool
        Whether the output turns against the input (`ratio` is always positive).
    rated_torque_nm : float
        T_N at the output, N·m.
    acceleration_torque_nm, momentary_peak_torque_nm : float
        Permissible at starts and stops, and in emergencies, N·m at the output.
    max_input_speed_rpm : float
        1/min.
    region_torques_nm : pair of float or None
        T1 and T2 between the stiffness regions K1, K2, K3 (harmonic reducers), N·m.
    stiffness_interval : pair of float
        Interval of the stiffness as shares of the rated torque.
    lost_motion_rule : str
        Name of the maker's rule, one of `LOST_MOTION_RULES`.
    highest_error_order : float or None
        Highest order per output revolution of the transmission error that is reported; by
        default three times the ratio.
    certified_friction : tuple of CertifiedFriction
        Friction that a standard reducer's certificate states, at rising speeds.
    certificate : str
        Number of that certificate.
    """

    name: Annotated[str, Field(min_length=1)]
    kind: Literal["rv", "cycloidal", "harmonic", "other"]
    ratio: Positive
    rated_torque_nm: Positive
    acceleration_torque_nm: Positive
    momentary_peak_torque_nm: Positive
    max_input_speed_rpm: Positive
    maker: str = ""
    source: str = ""
    reversed: bool = False
    region_torques_nm: tuple[Positive, Positive] | None = None
    stiffness_interval: tuple[Annotated[float, Field(ge=0)], Positive] = (0.5, 1.0)
    lost_motion_rule: RuleName = "nabtesco"
    highest_error_order: Positive | None = None
    limits: DataSheetLimits = DataSheetLimits()
    certified_friction: tuple[CertifiedFriction, ...] = ()
    certificate: Annotated[str, Field(max_length=200)] = ""

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        """Refuse torques, regions, intervals or speeds out of order."""
        if not self.rated_torque_nm <= self.acceleration_torque_nm <= self.momentary_peak_torque_nm:
            raise ValueError(
                "rated_torque_nm, acceleration_torque_nm and momentary_peak_torque_nm have to rise"
            )
        if self.region_torques_nm and not self.region_torques_nm[0] < self.region_torques_nm[1]:
            raise ValueError("region_torques_nm has to hold T1 < T2")
        if not self.stiffness_interval[0] < self.stiffness_interval[1] <= 1.5:
            raise ValueError("stiffness_interval has to rise, to at most 1.5")
        speeds = [point.speed_rpm for point in self.certified_friction]
        if speeds != sorted(set(speeds)):
            raise ValueError("the speeds of certified_friction have to rise")
        return self

    @property
    def signed_ratio(self) -> float:
        """Input revolutions per output revolution, negative if the output reverses."""
        return -self.ratio if self.reversed else self.ratio


def available_reducers() -> tuple[str, ...]:
    """Return the names of the packaged types.

    Examples
    --------
    >>> available_reducers()
    ('harmonic-20', 'rv-40e', 'standard')
    """
    folder = resources.files("torquebench.reducers") / "types"
    return tuple(
        sorted(
            entry.name.removesuffix(".toml")
            for entry in folder.iterdir()
            if entry.name.endswith(".toml")
        )
    )


def load_reducer(name_or_path: str | Path) -> ReducerDescription:
    """Return a packaged description by its name, or one from a TOML file by its path.

    Raises
    ------
    InputError
        There is no such description, or a key is missing, unknown or has an impossible value.

    Examples
    --------
    >>> load_reducer("rv-40e").rated_torque_nm
    412.0
    """
    name = str(name_or_path)
    if name in available_reducers():
        folder = resources.files("torquebench.reducers") / "types"
        content = (folder / f"{name}.toml").read_bytes()
    elif Path(name_or_path).is_file():
        content = Path(name_or_path).read_bytes()
    else:
        raise InputError(
            Message("no reducer {name!r}", name),
            Message(
                "the path of a .toml file, or one of {available_reducers}",
                ", ".join(available_reducers()),
            ),
            "check the path",
        )
    try:
        text = content.decode("utf-8")
    except UnicodeDecodeError as error:
        raise InputError(Message("{name}: {error}", name, error), "a TOML file in UTF-8") from error
    return validated(ReducerDescription, parse_toml(text, name), name)
