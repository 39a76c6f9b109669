"""
Torque-angle loops of a real cycloidal reducer
==============================================

A 3D-printed cycloidal reducer, its output locked, was loaded with torque ramps of ±4 N·m. The
loops give its backlash and stiffness.

The data were **measured** by J. Verhoeven, `Anti-Backlash-Cycloidal-Actuator
<https://github.com/JelmerV/Anti-Backlash-Cycloidal-Actuator>`_, and are used under the licence
`CC BY-SA 4.0 <https://creativecommons.org/licenses/by-sa/4.0/>`_. The excerpt
``cycloidal-loops.csv`` has every second row of three ramps at each of three output positions,
rounded, and stays under that licence. The torque comes from the motor's current; no torque
transducer was mounted.
"""

# %%
import matplotlib.pyplot as plt
import numpy as np

from torquebench.reducers import LoopSettings, evaluate_hysteresis

table = np.genfromtxt("data/cycloidal-loops.csv", delimiter=",", names=True, skip_header=3)
angle_rad = 2.0 * np.pi * table["angle_rev"]

_, axes = plt.subplots(figsize=(7.6, 4.2), layout="constrained")
for position in (1, 2, 3):
    rows = table["position"] == position
    angle = np.degrees(angle_rad[rows] - angle_rad[rows].mean())
    axes.plot(table["torque_nm"][rows], angle, linewidth=0.5, label=f"position {position}")
axes.legend(frameon=False)
axes.set_xlabel("torque at the output in N·m")
axes.set_ylabel("angle in °")

# %%
# A printed reducer creeps: its loops close within 6 % of their width only, which is stated here.
settings = LoopSettings(4.0, stiffness_interval=(0.4, 0.8), closure_share=0.06)
result = evaluate_hysteresis(
    table["torque_nm"],
    angle_rad,
    settings,
    position=table["position"],
    loop=table["ramp"],
    demanded_nm=table["demanded_nm"],
)
for quantity in result.quantities():
    estimate = quantity.estimate
    print(f"{quantity.title:38} {estimate.value:9.4g} ± "
          f"{estimate.expanded_uncertainty():.2g} {estimate.unit}")  # fmt: skip

# %%
# The author found a play of 2.501° as the mean of these positions. U contains how much the
# positions differ.
print(f"backlash {result.backlash.value / 60:.2f}°, by the author 2.501°")

# %%
# What the data show besides:
for finding in result.findings:
    print(f"{finding.name}: {finding.message}")
