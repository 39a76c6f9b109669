"""
Monte Carlo against GUM
=======================

The GUM propagates uncertainty linearly. JCGM 101 draws every quantity from its distribution
instead. Both intervals are compared by the criterion of JCGM 101, clause 8. The data are simulated.
"""

# %%
# A reading of a calibrated chain, with the uncertainty of the reference standard:
from pathlib import Path

import numpy as np

import torquebench as tb

calibration = tb.read_calibration(Path("../../examples") / "calibration-output.csv")
compensation = tb.fit(calibration, reference="0.02 of range")
torque = compensation.torque([1500.0, 20.0], branch="up")
for row in range(2):
    checked = torque.check(row, generator=np.random.default_rng(0))
    found = checked.monte_carlo
    budget = checked.budget
    low, high = budget.interval()
    print(f"GUM          {low:9.3f} to {high:9.3f} N·m")
    print(f"Monte Carlo  {found.low:9.3f} to {found.high:9.3f} N·m, {found.trials} trials")
    print(checked.sentence(), "\n")

# %%
# The linear propagation fails where the model is curved within the uncertainty, as a square near
# zero is.
import matplotlib.pyplot as plt

u = 0.1
value = np.random.default_rng(1).normal(0.05, u, 200_000) ** 2
gum = 0.05**2 + np.array([-2, 2]) * 2 * 0.05 * u
low, high = np.quantile(value, [0.02275, 0.97725])
print(f"x²: GUM {gum[0]:.4f} to {gum[1]:.4f}, Monte Carlo {low:.4f} to {high:.4f}")

_, axes = plt.subplots(figsize=(7.6, 3.0), layout="constrained")
axes.hist(value, bins=200, range=(-0.02, 0.08), color="#56B4E9")
for edge, name, style in ((gum, "GUM", "--"), ((low, high), "Monte Carlo", "-")):
    axes.vlines(edge, 0, axes.get_ylim()[1], color="#000000", linestyle=style, label=name)
axes.set_xlabel("x²")
axes.set_ylabel("number of trials")
axes.legend(frameon=False)
