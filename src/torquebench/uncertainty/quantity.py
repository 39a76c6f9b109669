"""One input quantity of a measurement: its value and its uncertainty."""

from dataclasses import dataclass
from math import inf, isfinite, isnan

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.uncertainty.distributions import HALF_WIDTH_FACTOR, Distribution

__all__ = ["Quantity"]


@dataclass(frozen=True)
class Quantity:
    """An input quantity with its standard uncertainty.

    Parameters
    ----------
    name : str
        What it is; unique within a budget.
    value : float
        Best estimate, in `unit`.
    standard_uncertainty : float
        Standard uncertainty, in `unit`, not negative.
    degrees_of_freedom : float
        Of the standard uncertainty; `inf` where it is taken as exactly known.
    distribution : Distribution
        Shape used by Monte Carlo; GUM propagation uses the standard uncertainty only.
    unit : str
        Unit, for the budget table.

    Raises
    ------
    InputError
        When a number is not finite, the uncertainty is negative, or the degrees of freedom are
        not positive.

    Examples
    --------
    >>> Quantity.rectangular("resolution", 0.0, half_width=0.5, unit="N·m").standard_uncertainty
    0.288675134594812...
    """

    name: str
    value: float
    standard_uncertainty: float
    degrees_of_freedom: float = inf
    distribution: Distribution = Distribution.NORMAL
    unit: str = ""

    def __post_init__(self) -> None:
        if not isfinite(self.value):
            raise InputError(Message("{name} = {value}", self.name, self.value), "a finite value")
        if not isfinite(self.standard_uncertainty) or self.standard_uncertainty < 0:
            raise InputError(
                Message(
                    "standard uncertainty of {name} = {standard_uncertainty}",
                    self.name,
                    self.standard_uncertainty,
                ),
                "a finite value, 0 or more",
            )
        if isnan(self.degrees_of_freedom) or self.degrees_of_freedom <= 0:
            raise InputError(
                Message(
                    "degrees of freedom of {name} = {degrees_of_freedom}",
                    self.name,
                    self.degrees_of_freedom,
                ),
                "above 0, inf when the uncertainty is exactly known",
            )

    @classmethod
    def rectangular(
        cls,
        name: str,
        value: float,
        half_width: float,
        degrees_of_freedom: float = inf,
        unit: str = "",
    ) -> "Quantity":
        """Anything within ±`half_width` is equally likely (resolution, manufacturer's limits)."""
        return cls._bounded(
            Distribution.RECTANGULAR, name, value, half_width, degrees_of_freedom, unit
        )

    @classmethod
    def triangular(
        cls,
        name: str,
        value: float,
        half_width: float,
        degrees_of_freedom: float = inf,
        unit: str = "",
    ) -> "Quantity":
        """Within ±`half_width` and likelier in the middle (difference of two resolutions)."""
        return cls._bounded(
            Distribution.TRIANGULAR, name, value, half_width, degrees_of_freedom, unit
        )

    @classmethod
    def arcsine(
        cls,
        name: str,
        value: float,
        half_width: float,
        degrees_of_freedom: float = inf,
        unit: str = "",
    ) -> "Quantity":
        """Cycling sinusoidally between ±`half_width` (a controlled temperature)."""
        return cls._bounded(Distribution.ARCSINE, name, value, half_width, degrees_of_freedom, unit)

    @classmethod
    def _bounded(
        cls,
        distribution: Distribution,
        name: str,
        value: float,
        half_width: float,
        degrees_of_freedom: float,
        unit: str,
    ) -> "Quantity":
        standard_uncertainty = half_width / HALF_WIDTH_FACTOR[distribution]
        return cls(name, value, standard_uncertainty, degrees_of_freedom, distribution, unit)

    @classmethod
    def from_certificate(
        cls,
        name: str,
        value: float,
        expanded_uncertainty: float,
        coverage_factor: float = 2.0,
        degrees_of_freedom: float = inf,
        unit: str = "",
    ) -> "Quantity":
        """From a certificate's expanded uncertainty U = k·u."""
        if not coverage_factor > 0:
            raise InputError(
                Message("coverage factor of {name} = {coverage_factor}", name, coverage_factor),
                "above 0",
            )
        return cls(
            name, value, expanded_uncertainty / coverage_factor, degrees_of_freedom, unit=unit
        )
