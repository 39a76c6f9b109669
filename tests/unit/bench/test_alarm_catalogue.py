from torquebench.bench.safety.alarms import ALARM_CATALOGUE, AlarmKind


def test_every_alarm_is_explained() -> None:
    assert list(ALARM_CATALOGUE) == list(AlarmKind)
    for entry in ALARM_CATALOGUE.values():
        assert entry.cause.endswith(".")
        assert entry.remedy.endswith(".")
