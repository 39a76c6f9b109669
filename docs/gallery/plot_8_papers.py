"""
Items of the two source papers
==============================

``torquebench papers`` reproduces the two source papers item by item. This example takes two of
them: the additional torque of a design, and the BP network against a polynomial. The chain is
simulated.
"""

# %%
# Bearing friction and misalignment add to the torque of the output module, by the equations of the
# 2021 article in their consistent form:
from torquebench.papers.mechanics import DESIGNS, additional_torque_blocks

answer, blocks = additional_torque_blocks(DESIGNS["output"])
print(answer.ours)

# %%
# The network of the papers and a quadratic, fitted to the rising points of one calibration. The
# network's start weights and epochs aren't published; they decide.
from pathlib import Path

import numpy as np

import torquebench as tb
from torquebench.compensation import make_model

examples = Path("../../examples")
calibration = tb.read_calibration(examples / "calibration-output.csv")
rising = calibration.branch >= 0
X, y = calibration.features()[rising], calibration.standard_nm[rising]
fresh = tb.read_calibration(examples / "verification-output.csv")
for name, model in (
    ("quadratic", make_model("polynomial-2", range_nm=2000.0)),
    ("BP network, 5000 epochs",
     make_model("published-network", range_nm=2000.0, start="small-uniform", epochs=5000)),
):  # fmt: skip
    error = model.fit(X, y).predict(fresh.features()) - fresh.standard_nm
    print(f"{name:24} worst {np.abs(error).max():5.2f} N·m at fresh points")

# %%
# :doc:`/explanation/source-papers` lists every item with its command.
