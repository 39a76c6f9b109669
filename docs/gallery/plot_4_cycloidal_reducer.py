"""
Torque-angle loops of a real cycloidal reducer
==============================================

A 3D-printed cycloidal reducer, its output locked, was loaded with torque ramps of ±4 N·m. The
loops give its backlash and stiffness.

The data were **measured** by J. Verhoeven, `Anti-Backlash-Cycloidal-Actuator
<https://github.com/JelmerV/Anti-Backlash-Cycloidal-Actuator>`_, under the licence `CC BY-SA 4.0
<https://creativecommons.org/licenses/by-sa/4.0/>`_. The torque comes from the motor's current; no
torque transducer was mounted. This project holds no copy of them: the example reads the files
``*torqueramp__base_runin1``, ``5`` and ``6.csv.gz`` from the folder ``cycloidal-reducer`` in
``$TORQUEBENCH_REFERENCE_DATA``. Where they are missing it makes a loop of the same size and says
that it is simulated.
"""

# %%
import gzip
import os
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from torquebench.reducers import LoopSettings, evaluate_hysteresis

folder = Path(os.environ.get("TORQUEBENCH_REFERENCE_DATA", "../../../shared/data"))
files = sorted((folder / "cycloidal-reducer").glob("*base_runin[156].csv.gz"))


def measured():
    """Return position, ramp, demanded torque, torque (N·m) and angle (turns) of ramps 1 to 3."""
    parts = []
    for position, file in enumerate(files, start=1):
        with gzip.open(file, "rt") as lines:
            rows = np.loadtxt(lines, delimiter=",", skiprows=1)
        rows = rows[rows[:, 6] < 100]
        parts.append(np.column_stack([np.full(len(rows), position), rows[:, [6, 3, 2, 1]]]))
    return np.vstack(parts).T


def simulated():
    """Return the same columns of loops with a play of 2.5° and 0.08 °/(N·m)."""
    leg = np.linspace(-1.0, 1.0, 600)
    ramp = 4.0 * np.concatenate([leg, leg[::-1]])
    torque = np.concatenate([[0.0], np.tile(ramp, 4), -4.0 * leg[:301]])
    degrees, teeth = np.empty(torque.size), 0.0
    for place, load in enumerate(torque):  # the shaft moves once a flank is reached
        teeth = np.clip(teeth, 8.0 * load - 1.25, 8.0 * load + 1.25)
        degrees[place] = 0.08 * load + np.clip(teeth, -1.25, 1.25)
    number = np.ones(torque.size)
    parts = [[number * each, number, torque, torque, degrees / 360.0] for each in (1, 2, 3)]
    return np.hstack(parts)


position, ramp, demanded_nm, torque_nm, turns = measured() if files else simulated()
angle_rad = 2.0 * np.pi * turns
print("measured by J. Verhoeven, CC BY-SA 4.0" if files else "simulated: the files are missing")

_, axes = plt.subplots(figsize=(7.6, 4.2), layout="constrained")
for each in (1, 2, 3):
    rows = position == each
    angle = np.degrees(angle_rad[rows] - angle_rad[rows].mean())
    axes.plot(torque_nm[rows], angle, linewidth=0.5, label=f"position {each}")
axes.legend(frameon=False)
axes.set_xlabel("torque at the output in N·m")
axes.set_ylabel("angle in °")

# %%
# A printed reducer creeps: its loops close within 6 % of their width only, which is stated here.
settings = LoopSettings(4.0, stiffness_interval=(0.4, 0.8), closure_share=0.06)
result = evaluate_hysteresis(
    torque_nm, angle_rad, settings, position=position, loop=ramp, demanded_nm=demanded_nm
)
for quantity in result.quantities():
    estimate = quantity.estimate
    print(f"{quantity.title:38} {estimate.value:9.4g} ± "
          f"{estimate.expanded_uncertainty():.2g} {estimate.unit}")  # fmt: skip

# %%
# The author found a play of 2.501° as the mean of these positions. U contains how much the
# positions differ.
by_author = "by the author 2.501°" if files else "simulated with 2.5°"
print(f"backlash {result.backlash.value / 60:.2f}°, {by_author}")

# %%
# What the data show besides:
for finding in result.findings:
    print(f"{finding.name}: {finding.message}")
