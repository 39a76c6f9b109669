"""Steps and sines of torque on the simulated bench, and the dynamics that follow from them."""

from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from tests.support.draws import nightly
from tests.watching import Watching

from torquebench.bench.roles import Side
from torquebench.campaign.dynamics import identify_dynamics
from torquebench.campaign.measuring import RunAbortedError
from torquebench.campaign.turning_runs import measure_turning, read_begun, rehearse_turning
from torquebench.dynamics import MotorInertia
from torquebench.errors import InputError, LimitError
from torquebench.procedures.turning.profile import TurningProfile
from torquebench.procedures.turning.stepping import StepTable
from torquebench.station import Station
from torquebench.twin import TwinParameters
from torquebench.units import RPM_PER_RAD_S

SHORT = {
    "name": "short",
    "kind": "dynamics",
    "steps": {"shares": [0.005, 0.01], "cycles": 12},
}


def profile(**changes: object) -> TurningProfile:
    return TurningProfile.model_validate({**SHORT, **changes})


def rows_of(path: Path) -> np.ndarray:
    lines = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    assert lines[0] == ",".join(StepTable.COLUMNS)
    return np.array([[float(cell) for cell in line.split(",")] for line in lines[1:]]).T


def empty_run(path: Path, inertia_kgm2: float, top_rpm: float) -> Path:
    """Ramps of two rates with the torque of an inertia."""
    time = np.arange(0.0, 40.0, 0.01)
    speed = np.interp(time, [0, 4, 12, 14, 18, 22, 30, 32, 40],
                      np.array([0, 0, 1, 1, 0, 0, -1, -1, 0]) * top_rpm)  # fmt: skip
    speed = np.convolve(np.pad(speed, 10, mode="edge"), np.full(21, 1 / 21), "valid")
    slope = np.gradient(speed, time) / RPM_PER_RAD_S
    reading = inertia_kgm2 * slope
    reading += 1e-3 * np.abs(reading).max() * np.random.default_rng(1).standard_normal(time.size)
    rows = "\n".join(
        f"{t:.3f},{r:.9g},{s:.9g}" for t, r, s in zip(time, reading, speed, strict=True)
    )
    path.write_text(f"time_s,reading_nm,speed_rpm\n{rows}\n")
    return path


@pytest.mark.parametrize("side", ["output", nightly("input")])
def test_the_bench_s_own_steps_identify_stiffness_damping_and_delay(
    station: Station, tmp_path: Path, side: Side
) -> None:
    file = tmp_path / "steps.csv"
    done = measure_turning(station, side, profile(), file)
    time_s, _, standard, segment, period = rows_of(file)
    assert done.rows == time_s.size
    assert segment.max() == 48
    assert not period.any()
    full = station.description.module(side).range_nm
    assert np.all(np.abs(standard - 0.2 * full) < 0.05 * full)
    assert not station.drivers.drives[side].state().enabled
    text = file.read_text()
    assert "# simulated = true" in text
    assert "# motor_inertia_kgm2 = " in text
    truth = getattr(TwinParameters.draw("nominal", 1), side)
    drive, known = truth.drive, MotorInertia(truth.drive.motor_inertia_kgm2, 0.0)
    top_rpm = 1200.0 if side == "input" else 15.0
    empty = empty_run(tmp_path / "empty.csv", drive.flange_inertia_kgm2, top_rpm)
    with pytest.raises(InputError, match="between transducer and flange") as refused:
        identify_dynamics([file])
    assert "empty run" in str(refused.value)
    bare = tmp_path / "bare.csv"
    bare.write_text(text.replace("motor_inertia", "other"))
    with pytest.raises(InputError, match="the inertia that vibrates") as refused:
        identify_dynamics([bare], empty)
    assert "--motor-inertia" in str(refused.value)
    import torquebench.campaign.dynamics as module

    # the ramps of this test aren't compensated, but nor do they need it
    module_doubt, module._UNCOMPENSATED = module._UNCOMPENSATED, 0.0
    try:
        found = identify_dynamics([file], empty, motor=known)
    finally:
        module._UNCOMPENSATED = module_doubt
    assert found.shaft is not None
    for value, u, true in (
        (found.shaft.stiffness_nm_rad, found.shaft.stiffness_uncertainty_nm_rad,
         drive.stiffness_nm_rad),
        (found.shaft.damping_nm_s, found.shaft.damping_uncertainty_nm_s, drive.damping_nm_s),
    ):  # fmt: skip
        assert abs(value - true) < 4.0 * u + 0.01 * true
        assert u < 0.15 * true
    delay, lag = found.transfer.lag_s + found.transfer.delay_s, truth.transducer
    covariance = np.asarray(found.transfer.covariance)[2:, 2:]
    u_s = float(np.sqrt(covariance.sum()))
    assert u_s < 1e-4
    assert abs(delay - lag.lag_s - lag.delay_s) < 4.0 * u_s
    # the rate that three times the bandwidth needs
    step = found.designed
    assert step.compensated.bandwidth_hz > 3.0 * step.raw.bandwidth_hz
    assert found.effect.interval_s < 1e-3


def test_an_aborted_run_keeps_its_series_and_a_pause_repeats_a_leg(
    station: Station, tmp_path: Path
) -> None:
    file = tmp_path / "steps.csv"
    steps = {"shares": [0.01], "cycles": 5, "hold_s": 0.1}
    chosen = profile(
        steps=steps, repeats=2, sines={"share": 0.05, "periods_s": [2, 1], "cycles": 1}
    )

    def stop(done: int, _detail: str) -> None:
        if done >= 4:  # of six legs: in the second series
            station.abort("enough")

    with pytest.raises(RunAbortedError):
        measure_turning(station, "input", chosen, file, progress=Watching(stop))
    first = rows_of(file)
    assert "# series_done = 1 of 2" in file.read_text()
    assert set(np.unique(first[4])) == {0.0, 1.0, 2.0}
    serial = station.description.input.transducer.serial
    begun = read_begun(file, "input", chosen, serial)
    assert isinstance(begun, StepTable)
    paused: list[int] = []
    torques: list[float] = []

    def pause(done: int, _detail: str) -> None:
        if done == 3 and not paused:
            paused.append(done)
            station.pause()

    def look(held: Station) -> Literal["resume"]:
        now, truth = held.clock.now(), held.drivers.truth
        assert truth is not None
        torques.append(abs(truth.true_torque("input", now - 0.01, now)))
        return "resume"

    measure_turning(
        station, "input", chosen, file, begun=begun, progress=Watching(pause),
        on_pause=look,
    )  # fmt: skip
    whole = rows_of(file)
    assert max(torques) < 0.05 * 50.0  # preloaded with 10 N·m before
    np.testing.assert_allclose(whole[:, : first.shape[1]], first)
    assert whole[3].max() == 2 * first[3].max()
    assert np.all(np.diff(whole[0]) > 0.0)
    with pytest.raises(InputError, match="complete"):
        read_begun(file, "input", chosen, serial)


def test_profiles_beyond_the_bench_or_without_steps_are_refused(station: Station) -> None:
    with pytest.raises(ValueError, match="needs steps"):
        profile(steps=None)
    with pytest.raises(ValueError, match="speed_shares"):
        profile(speed_shares=[1.0])
    with pytest.raises(ValueError, match="beyond the range"):
        profile(steps={"preload_share": 1.0, "shares": [0.01]})
    quick = profile(sines={"share": 0.4, "periods_s": [2, 1]})
    with pytest.raises(LimitError, match=r"1\.26 s or more"):
        rehearse_turning(station, "input", quick)
    large = profile(steps={"shares": [0.2]})
    with pytest.raises(LimitError, match="a step of 10 N·m, which takes the drive 100 ms"):
        rehearse_turning(station, "input", large)
