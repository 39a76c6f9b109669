from importlib import resources
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from torquebench.bench import default_bench, load_bench, parse_bench
from torquebench.bench.description import DEFAULT_BENCH
from torquebench.errors import InputError
from torquebench.units import RAD_S_PER_RPM

TEXT = (resources.files("torquebench.bench") / DEFAULT_BENCH).read_text(encoding="utf-8")
EXAMPLES = sorted((Path(__file__).parents[3] / "examples").glob("*.toml"))


def refused(old: str, new: str) -> InputError:
    assert old in TEXT
    with pytest.raises(InputError) as caught:
        parse_bench(TEXT.replace(old, new, 1), "mine.toml")
    return caught.value


def test_the_default_is_a_simulated_bench_with_the_sources_ranges() -> None:
    bench = default_bench()
    assert bench.simulated
    assert (bench.input.range_nm, bench.output.range_nm) == (50.0, 2000.0)
    assert bench.bench.reducer_ratio == 80.0
    assert bench.input.transducer.scale().sensitivity_cw == 600.0
    assert bench.output.transducer.scale().limits == (15e3, 105e3)


def test_a_side_stands_up_to_its_stated_speed_and_not_at_an_unknown_one() -> None:
    safety = default_bench().safety
    assert safety.standstill_rpm == 0.5
    assert safety.at_standstill(-0.49 * RAD_S_PER_RPM)
    assert not safety.at_standstill(-0.51 * RAD_S_PER_RPM)
    assert not safety.at_standstill(float("nan"))


def test_a_side_is_unloaded_up_to_a_share_of_its_range() -> None:
    assert default_bench().unloaded_nm("output") == pytest.approx(20.0)


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.name)
def test_every_example_is_a_valid_description(path: Path) -> None:
    assert load_bench(path).name


@pytest.mark.parametrize(
    ("old", "new", "found", "allowed"),
    [
        ("range_nm = 50\n", "range_nm = -1\n", "input.range_nm = -1", "above 0 to 1,000,000 N·m"),
        ("range_nm = 50\n", 'range_nm = "x"\n', "input.range_nm = 'x'", "N·m"),
        ("range_nm = 50\n", "range_nm = 60\n", "input.range_nm = 60", "nominal 50 N·m"),
        ("range_nm = 50\n", "", "input.range_nm is missing", "N·m"),
        ("range_nm = 50\n", "rangenm = 50\n", "input.rangenm is not a key", "range_nm"),
        ("option_khz = 60", "option_khz = 61", "input.transducer.option_khz = 61", "60, 240"),
        ("torque_nm = 60\n", "torque_nm = 9\n", "input.limits.torque_nm = 9", "75 N·m"),
        ("SIM-CAL-1-IN", "SIM-T50", "calibrator.input.serial = 'SIM-T50'", "input.transducer"),
        ("100e6", "nan", "counter.timebase_hz = nan", "1,000,000 to 1,000,000,000 Hz"),
        ("window_s = 0.01", "window_s = 0.03", "counter.block_s = 0.05", "window_s = 0.03"),
        (
            "option_khz = 60\n",
            "option_khz = 60\nsensitivity_cw_hz_per_nm = 500\n",
            "input.transducer.sensitivity_cw_hz_per_nm = 500",
            "570 to 630",
        ),
        (
            'temperature_probe = "input_transducer"',
            'temperature_probe = "nowhere"',
            "input.temperature_probe = 'nowhere'",
            "ambient",
        ),
        (
            'CAL-1-IN"\nnominal_torque_nm = 50',
            'CAL-1-IN"\nnominal_torque_nm = 20',
            "calibrator",
            "50",
        ),
        ("seed = 1", "seed = ", "line", "valid TOML"),
    ],
)
def test_a_wrong_key_is_named_with_its_value_and_what_is_allowed(
    old: str, new: str, found: str, allowed: str
) -> None:
    error = refused(old, new)
    assert error.found.startswith("mine.toml: ")
    assert found in error.found
    assert allowed in error.allowed
    assert error.remedy


def test_further_wrong_keys_are_named_after_the_first() -> None:
    error = refused("window_s = 0.01\nblock_s = 0.05", "window_s = 9\nblock_s = -1")
    assert "counter.window_s = 9" in error.found
    assert "counter.block_s" in error.remedy


@given(st.text(max_size=200))
def test_no_text_gives_anything_but_a_description_or_an_input_error(text: str) -> None:
    with pytest.raises(InputError):
        parse_bench(text)


@given(
    st.dictionaries(
        st.sampled_from(["bench", "counter", "input", "output", "driver", "temperatures", "x"]),
        st.one_of(st.integers(), st.floats(), st.text(max_size=5), st.lists(st.integers())),
    )
)
def test_no_wrong_section_escapes(sections: dict[str, object]) -> None:
    from torquebench.bench.description import BenchDescription
    from torquebench.validation import validated

    with pytest.raises(InputError):
        validated(BenchDescription, sections, "bench.toml")


@pytest.mark.parametrize("content", [None, b"\xff\xfe", b""], ids=["missing", "binary", "empty"])
def test_an_unreadable_file_is_an_input_error(tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "bench.toml"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=r"bench\.toml"):
        load_bench(path)


def test_a_certificate_file_is_found_beside_the_description(tmp_path: Path) -> None:
    path = tmp_path / "bench.toml"
    number = 'certificate_number = "SIM-CERT-1"'
    path.write_text(TEXT.replace(number, f'{number}\ncertificate = "cal.csv"'), encoding="utf-8")
    assert load_bench(path).calibrator.certificate == str(tmp_path.resolve() / "cal.csv")


def test_the_driver_refuses_options_that_it_does_not_have() -> None:
    from torquebench.bench.drivers import open_drivers

    with pytest.raises(InputError, match=r"driver: presett is not a key"):
        open_drivers(parse_bench(TEXT.replace("preset =", "presett =")))
    with pytest.raises(InputError, match="simulated"):
        open_drivers(parse_bench(TEXT.replace('driver = "simulated"', 'driver = "other"')))
