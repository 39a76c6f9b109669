import pytest
from tests.unit.chain.test_measuring_chain import EFFECTS_OF_ALL_KINDS, OF_LIMITS, calibration

from torquebench.chain import MeasuringChain, Readings
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
