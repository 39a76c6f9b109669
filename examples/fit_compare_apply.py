"""Fit, compare and apply compensation models of a calibration (simulated example data)."""

# %% A calibration as any laboratory would have it: readings beside the standard's torque.
from pathlib import Path

from torquebench.calibration import verify
from torquebench.chain import MeasuringChain, Reference
from torquebench.compensation import RECOMMENDED, compare, make_model
from torquebench.tables import read_calibration, read_readings
from torquebench.uncertainty import CertifiedUncertainty

folder = Path(__file__).parent
data = read_calibration(folder / "calibration-output.csv")

# %% Fit the recommended model, and compare all models on points that they haven't seen.
model = make_model(RECOMMENDED, range_nm=data.range_nm).fit(data.features(), data.standard_nm)
for score in compare(data.features(), data.standard_nm, range_nm=data.range_nm).scores:
    print(f"{score.name:18} worst {score.worst_percent_fs:.3f} % FS")

# %% Check it at fresh points off the calibration's grid.
check = read_calibration(folder / "verification-output.csv")
standard = Reference("certificate 17", CertifiedUncertainty.flat(0.4, 40.0, 2000.0))
chain = MeasuringChain(model, (standard,))
for found in verify(check, {RECOMMENDED: chain}).models:
    print(f"fresh points, {found.name}: {found.against_standard.worst_percent_fs:.3f} % FS worst")

# %% Apply it: torque at the reducer with its expanded uncertainty, and where that comes from.
readings = read_readings(folder / "readings-output.csv").readings()
print(chain.torque(readings).budget(0).text())
