import numpy as np
import pytest

from torquebench.bench.compensating import AcceptedCounter, ActiveCompensation
from torquebench.compensation import make_model
from torquebench.errors import InputError

CLOCK = "PXI-1/oscillator-1"


def fitted() -> object:
    reading = np.linspace(-2000.0, 2000.0, 41)
    return make_model("polynomial", degree=2).fit(reading[:, None], 1e-6 * reading**2)


@pytest.mark.parametrize("tolerance_ppm", [0.0, -1.0, 1e4, float("nan")])
def test_a_tolerance_that_no_clock_has_is_refused(tolerance_ppm: float) -> None:
    with pytest.raises(InputError, match="ppm"):
        AcceptedCounter(CLOCK, tolerance_ppm)


def test_the_uncertainty_of_another_clock_is_added_in_quadrature() -> None:
    model = fitted()
    own = ActiveCompensation(model, "1", "polynomial")  # type: ignore[arg-type]
    accepted = AcceptedCounter(CLOCK, tolerance_ppm=100.0)
    other = ActiveCompensation(model, "1", "polynomial", accepted, zero_nm=4000.0)  # type: ignore[arg-type]
    reading = np.array([-1500.0, 0.0, 1500.0])
    before, after = (each.samples(reading, 0.0, 23.0) for each in (own, other))
    np.testing.assert_array_equal(before.torque_nm, after.torque_nm)
    added = 1e-4 * (4000.0 + np.abs(after.torque_nm)) / np.sqrt(3.0)
    expected = np.hypot(before.standard_uncertainty_nm, added)
    np.testing.assert_allclose(after.standard_uncertainty_nm, expected)
    torque, uncertainty = other.value(1500.0, 0.0, 23.0)
    assert torque == pytest.approx(after.torque_nm[2], abs=1e-2)
    assert uncertainty == pytest.approx(after.standard_uncertainty_nm[2], rel=1e-3)
