"""
A chain that rotates
====================

Bearings, temperature and inertia add to the torque of a chain that was calibrated at standstill.
An empty run, with nothing mounted, identifies them. The data are simulated here, so the true
torque is known.
"""

# %%
# A chain of 50 N·m with drag (Coulomb and viscous), a zero that drifts by 10 mN·m per kelvin, and
# inertia.
import matplotlib.pyplot as plt
import numpy as np

from torquebench.chain import (
    EmptyRun,
    MeasuringChain,
    Readings,
    RecordedStream,
    TurningCalibration,
    identify,
)
from torquebench.compensation import features, make_model

RANGE_NM, INERTIA_KGM2 = 50.0, 0.002
random = np.random.default_rng(3)


def added_nm(time_s, speed_rpm, celsius):
    """Return what rotation, temperature and inertia add to a reading."""
    drag = 0.02 * np.tanh(speed_rpm / 5.0) + 2e-5 * speed_rpm
    acceleration = np.gradient(speed_rpm, time_s) * 2.0 * np.pi / 60.0
    noise = 0.004 * random.standard_normal(speed_rpm.size)
    return drag + 0.01 * (celsius - 23.0) + INERTIA_KGM2 * acceleration + noise


def empty_run(celsius):
    """Return a run through all speeds, in both directions, slowly and fast."""
    time_s = 0.05 * np.arange(4000)
    speed = 1000.0 * np.sin(2.0 * np.pi * time_s / 100.0) ** 3
    speed[2000:] = 1000.0 * np.sin(2.0 * np.pi * time_s[2000:] / 12.5)
    warm = np.full(speed.size, celsius)
    return EmptyRun(f"{celsius:g} °C", time_s, added_nm(time_s, speed, warm), speed, warm)


# %%
# The calibration at standstill, and empty runs at three temperatures:
standard = np.tile(np.linspace(-RANGE_NM, RANGE_NM, 41), 2)
reading = 1.002 * standard + 0.004 * random.standard_normal(standard.size)
branch = np.where(np.gradient(np.abs(standard)) >= 0.0, 1.0, -1.0)
calibration = TurningCalibration(
    reading,
    standard,
    branch,
    temperature_c=np.full(standard.size, 23.0),
    speed_rpm=np.zeros(standard.size),
)
found = identify(calibration, [empty_run(each) for each in (12.0, 23.0, 38.0)], RANGE_NM)
for effect in found.effects:
    print(type(effect).__name__)

# %%
# A quick, warm record: torque, speed and temperature change at once.
time_s = 0.05 * np.arange(1200)
true = 40.0 * np.sin(0.11 * time_s)
speed, celsius = 900.0 * np.sin(0.3 * time_s), 25.0 + 8.0 * np.sin(0.05 * time_s)
record = Readings(
    1.002 * true + added_nm(time_s, speed, celsius),
    time_s=time_s,
    speed_rpm=speed,
    temperature_c=celsius,
)
curve = make_model("polynomial-1", range_nm=RANGE_NM).fit(features(found.corrected_nm), standard)
static = MeasuringChain(curve)
whole = static.with_effects(found.effects)
_, axes = plt.subplots(figsize=(7.6, 3.4), layout="constrained")
for name, chain in (("static curve only", static), ("with empty runs", whole)):
    torque = RecordedStream(chain).torque(record, None)
    error = torque.value_nm - true
    inside = np.mean(np.abs(error) <= torque.expanded_uncertainty_nm)
    print(f"{name}: worst {np.abs(error).max():.3f} N·m, coverage of U {100 * inside:.0f} %")
    axes.plot(time_s, 1e3 * error, linewidth=0.7, label=name)
axes.set_xlabel("time in s")
axes.set_ylabel("error in mN·m")
axes.legend(frameon=False, loc="upper right")
