"""
From a calibration table to torque with U
=========================================

A calibration is a table of readings beside the torque of a reference standard. This example fits
the recommended compensation to it and applies that to readings. The data are simulated.
"""

# %%
# Headers without a known name get one: ``columns={"reading": "Anzeige[Nm]"}``. This table has the
# names ``reading_nm``, ``standard_nm`` and ``branch``.
from pathlib import Path

import matplotlib.pyplot as plt

import torquebench as tb

examples = Path("../../examples")
calibration = tb.read_calibration(examples / "calibration-output.csv")
compensation = tb.fit(calibration, reference="0.02 of range")
print(compensation)

# %%
# The additional torque is what the measuring chain adds: standard minus reading. The band is the
# expanded uncertainty U (k = 2) of the curve.
_, axes = plt.subplots(figsize=(7.6, 3.8), layout="constrained")
drawing = tb.plot(compensation, ax=axes)

# %%
# Readings become torque with U. A frame of pandas, polars or pyarrow comes back as one.
torque = compensation.torque([1500.0, -300.0], branch=["up", "down"])
for value, expanded in zip(torque.value_nm, torque.expanded_uncertainty_nm, strict=True):
    print(f"{value:9.2f} N·m ± {expanded:.2f} N·m")

# %%
# The budget says where U of the first reading comes from.
print(torque.budget(0).text())

# %%
# ``compensation.save("model.json")`` writes the file that the commands, the bench and the panel
# read.
