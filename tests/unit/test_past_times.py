"""When something was done: no day or time that hasn't come yet, in the reader's time zone."""

import time
from collections.abc import Iterator
from datetime import UTC, date, datetime, timedelta

import pytest

from torquebench.errors import InputError
from torquebench.operations.readings import day_or_time
from torquebench.validation import past_moment


@pytest.fixture(params=["UTC", "Asia/Shanghai", "Pacific/Kiritimati", "America/Los_Angeles"])
def zone(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    monkeypatch.setenv("TZ", request.param)
    time.tzset()
    yield request.param
    monkeypatch.undo()
    time.tzset()


def local(moment: datetime) -> str:
    return f"{moment.astimezone():%Y-%m-%dT%H:%M:%S}"


def test_today_is_allowed_and_tomorrow_is_not(zone: str) -> None:
    today = date.today()  # in the reader's time zone
    assert past_moment(today) <= datetime.now(UTC)
    with pytest.raises(InputError, match=f"performed on {today + timedelta(days=1)}, in the fut"):
        past_moment(day_or_time(str(today + timedelta(days=1))))


def test_a_time_without_a_zone_is_local(zone: str) -> None:
    now = datetime.now(UTC).replace(microsecond=0)
    assert past_moment(day_or_time(local(now))) == now
    with pytest.raises(InputError, match="in the future"):
        past_moment(day_or_time(local(now + timedelta(minutes=30))))


def test_a_time_with_a_zone_is_compared_in_it(zone: str) -> None:
    now = datetime.now(UTC)
    elsewhere = (now + timedelta(hours=14)).replace(tzinfo=None).isoformat()
    assert past_moment(day_or_time(f"{elsewhere}+14:00")) == now
    with pytest.raises(InputError, match="in the future"):
        past_moment(day_or_time(f"{elsewhere}+13:00"))


def test_clocks_may_differ_by_minutes(zone: str) -> None:
    assert past_moment(datetime.now(UTC) + timedelta(minutes=3))
    with pytest.raises(InputError):
        past_moment(datetime.now(UTC) + timedelta(minutes=10))


def test_a_past_day_keeps_its_name_in_utc(zone: str) -> None:
    assert past_moment(day_or_time("2025-03-02")) == datetime(2025, 3, 2, tzinfo=UTC)


@pytest.mark.parametrize("text", ["1.3.2025", "yesterday", "2025-13-01", "0001-01-01T00:00+14:00"])
def test_what_is_no_day_is_refused_with_an_example(text: str) -> None:
    with pytest.raises(ValueError, match="2026-01-31"):
        day_or_time(text)
