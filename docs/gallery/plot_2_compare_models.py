"""
Compare models of a measuring chain
===================================

Cross-validation leaves out whole steps of the calibration. The error at these steps shows what a
model does between calibrated torques. The data are simulated.
"""

# %%
from pathlib import Path

import matplotlib.pyplot as plt

import torquebench as tb

calibration = tb.read_calibration(Path("../../examples") / "calibration-output.csv")
kinds = ["polynomial-1", "polynomial-2", "polynomial-3", "bayesian-network", "hybrid"]
comparison = tb.compare(calibration, kinds)
print(comparison)

# %%
# The filled mark is the RMS error, the open one the worst error. The best model is green.
_, axes = plt.subplots(figsize=(7.6, 3.4), layout="constrained")
drawing = tb.plot(comparison, ax=axes)

# %%
# The verification at fresh torques, in the second file, decides whether the model is good enough.
from torquebench.calibration import verify

fresh = tb.read_calibration(Path("../../examples") / "verification-output.csv")
compensation = tb.fit(calibration, reference="0.02 of range")
for found in verify(fresh, {"hybrid": compensation.chain}).models:
    errors = found.against_standard
    print(f"{found.name:7} worst {errors.worst_percent_fs:.3f} % FS, "
          f"RMS {errors.rms_percent_fs:.3f} % FS")  # fmt: skip
