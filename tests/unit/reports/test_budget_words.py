import pytest
from tests.unit.chain.test_measuring_chain import EFFECTS_OF_ALL_KINDS, OF_LIMITS, calibration

from torquebench.chain import (
    MeasuredRotation,
    MeasuredTemperature,
    MeasuringChain,
    Readings,
    Temperature,
    Zero,
)
from torquebench.compensation import make_model
from torquebench.panel.text import Text
from torquebench.reports.certificate.labels import LANGUAGES, labels_of


@pytest.mark.parametrize("effects", [OF_LIMITS, EFFECTS_OF_ALL_KINDS], ids=["limits", "measured"])
def test_every_component_has_words_on_certificates_and_in_the_panel(effects: tuple) -> None:
    features, standard = calibration()
    model = make_model("physics", range_nm=2000.0).fit(features, standard)
    torque = MeasuringChain(model, effects).torque(Readings(features[:1, 0]))
    chinese = Text("zh")
    for component in torque.components:
        for language in LANGUAGES:
            assert f"budget_{component.name}" in labels_of(language), component.name
        assert chinese.core(component.name) != component.name


def test_every_influence_that_is_not_in_u_has_words_on_certificates_and_in_the_panel() -> None:
    features, standard = calibration()
    model = make_model("polynomial-1", range_nm=2000.0).fit(features, standard)
    nothing = ((0.0, 0.0), (0.0, 0.0))
    chains = [
        MeasuringChain(model),
        MeasuringChain(model, (Zero("zeros", None), Temperature("probe", None, None))),
        MeasuringChain(
            model,
            (
                MeasuredTemperature("runs", 23.0, 10.0, 40.0, (10.0, 40.0), (0.0,) * 2, (0.0,) * 2),
                MeasuredRotation(
                    "runs", 23.0, -600.0, 600.0, 10.0, 40.0, (0.0, 600.0), (10.0, 40.0),
                    nothing, nothing, nothing, nothing,
                ),
            ),
        ),
    ]  # fmt: skip
    missing = {name for chain in chains for name in chain.missing()}
    assert {"zero drift", "temperature of span", "drag over load, span over speed"} <= missing
    chinese = Text("zh")
    for name in missing:
        for language in LANGUAGES:
            assert f"missing_{name}" in labels_of(language), name
        assert chinese.core(name) != name
