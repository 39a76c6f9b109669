"""A model keeps the unit of the readings that it was fitted to: stored, applied, exported.

Factors are those of the units' definitions, written down here once more.
"""

import random
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result
from tests.support import draws
from typer.testing import CliRunner

from torquebench.cli import app
from torquebench.compensation import load_model
from torquebench.errors import InputError, ModelMismatchError

POUND_FORCE = 0.45359237 * 9.80665
TORQUES = {
    "lbf·ft": POUND_FORCE * 0.3048,
    "lbf·in": POUND_FORCE * 0.0254,
    "ozf·in": POUND_FORCE / 16.0 * 0.0254,
    "kgf·cm": 9.80665 * 0.01,
    "kgf·m": 9.80665,
    "N·mm": 1e-3,
    "N·cm": 1e-2,
    "mN·m": 1e-3,
    "kN·m": 1e3,
    "MN·m": 1e6,
}
"""N·m in one of each."""


def run(*arguments: str) -> Result:
    return CliRunner().invoke(app, list(arguments))


@dataclass
class Drawn:
    """A chain of which the reading is torque / gain + zero, in a unit."""

    unit: str
    gain: float
    """N·m by one of the unit as it is stated."""
    zero: float
    options: list[str]
    torque_nm: np.ndarray
    value: np.ndarray

    def table(self, header: str) -> str:
        lines = [f"Applied [N·m],{header}"]
        return "\n".join(
            [
                *lines,
                *(f"{t:.9g},{v:.12g}" for t, v in zip(self.torque_nm, self.value, strict=True)),
            ]
        )


def drawn(seed: int) -> Drawn:
    draw = random.Random(seed)
    largest = draw.choice([5.0, 80.0, 2000.0])
    leg = np.linspace(0.0, largest, 11)
    torque = np.concatenate([leg, leg[-2::-1], -leg[1:], -leg[-2::-1]])
    kind = ("torque", "signal", "points", "arm")[seed % 4]
    if kind == "torque":
        unit = draw.choice(list(TORQUES))
        return Drawn(unit, TORQUES[unit], 0.0, [], torque, torque / TORQUES[unit] * 0.998)
    if kind == "arm":
        arm = draw.choice([0.25, 0.5, 1.0])
        unit, newton = draw.choice([("N", 1.0), ("lbf", POUND_FORCE), ("kg", 9.80665)])
        value = torque / (newton * arm) * 0.998
        return Drawn(unit, newton * arm, 0.0, ["--arm", f"{arm}m"], torque, value)
    unit = draw.choice(["mV/V", "V", "kHz", "counts"])
    span, zero = draw.uniform(1.5, 12.0), draw.uniform(1.0, 20.0) if kind == "points" else 0.0
    text = f"{zero + span!r} {unit} at {largest!r} N·m"
    if zero:
        text = f"{zero!r} {unit} at 0 N·m; {text}"
    gain = largest / span
    value = zero + torque / gain * 0.998
    return Drawn(unit, gain, zero, ["--sensitivity", text], torque, value)


@pytest.mark.usefixtures("curve_alone")
@pytest.mark.parametrize("seed", draws.drawn(60, by_day=5))
def test_a_model_keeps_the_unit_of_its_readings(tmp_path: Path, seed: int) -> None:
    chain = drawn(seed)
    table, model, out = (tmp_path / name for name in ("t.csv", "m.json", "o.csv"))
    header = f"Measured [{chain.unit}]"
    table.write_text(chain.table(header), encoding="utf-8")
    fitted = run("fit", str(table), *chain.options, "--model", "polynomial-1", "--out", str(model))
    assert fitted.exit_code == 0, fitted.output
    scale = load_model(model).scale
    assert scale is not None
    assert scale.unit == chain.unit
    assert scale.nm_per_unit == pytest.approx(chain.gain, rel=1e-9)
    assert scale.offset_nm == pytest.approx(-chain.zero * chain.gain, abs=1e-9 * chain.gain)

    def applied(header: str, values: np.ndarray) -> np.ndarray:
        source = tmp_path / "r.csv"
        source.write_text("\n".join([header, *map(repr, values.tolist())]), encoding="utf-8")
        out.unlink(missing_ok=True)
        answer = run("apply", str(model), str(source), "--out", str(out))
        assert answer.exit_code == 0, answer.output
        return np.genfromtxt(out, delimiter=",", names=True, encoding="utf-8")["torque_nm"]

    span = float(np.max(chain.torque_nm))
    here = chain.torque_nm[3:8]
    torque = applied(header, chain.value[3:8])
    np.testing.assert_allclose(torque, here, atol=1e-3 * span)
    if chain.unit in TORQUES:  # any other unit of torque is as good
        again = applied("Measured [N·m]", chain.value[3:8] * chain.gain)
        np.testing.assert_allclose(again, torque, rtol=1e-9)
    else:
        (tmp_path / "r.csv").write_text("Measured [N·m]\n1.0\n", encoding="utf-8")
        out.unlink()
        refused = run("apply", str(model), str(tmp_path / "r.csv"), "--out", str(out))
        assert isinstance(refused.exception, ModelMismatchError)
        assert f"readings in {chain.unit}" in str(refused.exception)
        assert not out.exists()
    (tmp_path / "r.csv").write_text("Reading\n1.0\n", encoding="utf-8")
    asked = run("apply", str(model), str(tmp_path / "r.csv"), "--out", str(tmp_path / "no.csv"))
    assert isinstance(asked.exception, InputError)
    assert f"reading=Reading[{chain.unit}]" in str(asked.exception)


@pytest.mark.parametrize("ending", ["csv", "h"])
def test_an_export_states_how_readings_convert(tmp_path: Path, ending: str) -> None:
    for seed in range(4):
        chain = drawn(seed)
        table, model, out = (tmp_path / name for name in ("t.csv", "m.json", f"x.{ending}"))
        table.write_text(chain.table(f"Measured [{chain.unit}]"), encoding="utf-8")
        run("fit", str(table), *chain.options, "--model", "polynomial-1", "--out", str(model))
        assert run("export", str(model), "--out", str(out)).exit_code == 0
        stated = out.read_text(encoding="utf-8")
        plain = chain.unit.replace("·", " ")
        assert f"to be converted alike: N m = {chain.gain:.9g} * {plain}" in stated
