"""The page that explains U: its table names every effect."""

from pathlib import Path

from tests.unit.chain.test_measuring_chain import EFFECTS_OF_ALL_KINDS, OF_LIMITS, calibration

from torquebench.chain import MeasuringChain, Readings
from torquebench.compensation import make_model

PAGE = Path(__file__).parents[3] / "docs" / "explanation" / "what-u-contains.md"


def test_every_component_is_explained() -> None:
    features, standard = calibration()
    model = make_model("hybrid", range_nm=2000.0).fit(features, standard)
    limits = MeasuringChain(model, OF_LIMITS).torque(Readings(features[:1, 0]))
    measured = MeasuringChain(model, EFFECTS_OF_ALL_KINDS).torque(Readings(features[:1, 0]))
    table = PAGE.read_text(encoding="utf-8").split("## The effects")[1].split("\n\n")[1]
    named = table.replace("of zero, of span", "of zero, temperature of span")
    for component in (*limits.components, *measured.components):
        assert component.name in named, component.name
