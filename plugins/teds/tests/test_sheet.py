"""Data sheets are decoded as they were encoded, and a published sheet is decoded."""

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from torquebench.errors import InputError
from torquebench_teds import (
    BASIC,
    TEMPLATES,
    Section,
    Sheet,
    decode,
    encode,
    read_memory,
    sheet_from_json,
    sheet_to_json,
    write_memory,
)
from torquebench_teds.bits import (
    BitWriter,
    Constant,
    Day,
    Enumeration,
    Letters,
    Logarithmic,
    Single,
    Whole,
)
from torquebench_teds.templates import Array

# DEWETRON TRION SDK documentation, "TEDS Interface": two pages of a memory and what the vendor's
# own software says of them.
FOREIGN_PAGES = (
    "801F40620000000000841C000000000000000002000000000000006418008021"
    "46C10EC34800000000E000000000000000000000000000000000000000000000"
)
FOREIGN = {
    "min_physical": 0.0,
    "max_physical": 0.0,
    "min_electrical": 0.0,
    "max_electrical": 0.0,
    "bridge": "half",
    "impedance_ohm": 40.0,
    "response_time_s": 1e-6,
    "excitation_v": 2.5,
    "min_excitation_v": 1.0,
    "max_excitation_v": 6.0,
    "calibration_initials": "",
    "calibration_period_days": 0,
    "location": 0,
}
FOREIGN_DAYS = 37254


def values(kind: Any) -> st.SearchStrategy[Any]:
    if isinstance(kind, Whole):
        return st.integers(kind.low, kind.high or (1 << kind.width) - 1)
    if isinstance(kind, Enumeration):
        return st.sampled_from(kind.words)
    if isinstance(kind, Letters):
        letters = "ABCDEFGHIJKLMNOPQRSTUVWXYZ "
        return st.text(letters, max_size=kind.count).map(str.rstrip)
    if isinstance(kind, Day):
        return st.integers(0, (1 << 16) - 1).map(kind.decode)
    if isinstance(kind, Single):
        return st.floats(width=32, allow_nan=False, allow_infinity=False) | st.none()
    assert isinstance(kind, Constant | Logarithmic)
    return st.integers(0, (1 << kind.width) - 1).map(kind.decode)


def fields(of: Any) -> st.SearchStrategy[dict[str, Any]]:
    return st.fixed_dictionaries(
        {
            each.name: st.lists(fields(each.fields), max_size=4)
            if isinstance(each, Array)
            else values(each.kind)
            for each in of
        }
    )


SECTIONS = st.sampled_from(sorted(TEMPLATES)).flatmap(
    lambda number: fields(TEMPLATES[number].fields).map(lambda found: Section(number, found))
)
SHEETS = st.builds(
    Sheet,
    fields(BASIC),
    st.lists(SECTIONS, max_size=3).map(tuple),
    st.text(st.characters(min_codepoint=1, max_codepoint=126), max_size=20),
)


@given(SHEETS)
def test_a_sheet_comes_back_from_its_bits(sheet: Sheet) -> None:
    memory = write_memory(encode(sheet), 2560)
    assert decode(read_memory(memory)) == sheet
    assert sheet_from_json(sheet_to_json(sheet)) == sheet


@given(st.binary(min_size=1, max_size=62))
def test_any_bits_are_read_or_refused_and_never_changed(data: bytes) -> None:
    try:
        sheet = decode(data)
        again = encode(sheet)
    except InputError:
        return
    assert decode(again) == sheet


def test_a_foreign_memory_says_what_its_vendor_says() -> None:
    memory = bytes.fromhex(FOREIGN_PAGES)
    sheet = decode(read_memory(FOREIGN_PAGES.encode()))
    assert (sheet.basic["manufacturer"], sheet.basic["model"]) == (31, 393)
    assert (sheet.basic["version_letter"], sheet.basic["version"]) == ("", 0)
    assert sheet.basic["serial"] == 0
    (bridge,) = sheet.sections
    assert bridge.template == 33
    assert {name: bridge.values[name] for name in FOREIGN} == pytest.approx(FOREIGN)
    assert bridge.values["calibration_date"] == Day().decode(FOREIGN_DAYS) == "2099-12-31"
    assert write_memory(encode(sheet), len(memory)) == memory


def test_a_wrong_checksum_names_the_page_and_the_right_one() -> None:
    with pytest.raises(InputError, match=r"page 2: checksum 0x47; allowed: 0x46"):
        read_memory(FOREIGN_PAGES.replace("46C1", "47C1").encode())


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"\0" * 32, "blank memory"),
        (b"\xff" * 32, "blank memory"),
        (bytes.fromhex(FOREIGN_PAGES)[:40], "a memory of 40 bytes"),
        (b"80 1F 4", "5 hexadecimal digits"),
    ],
)
def test_what_is_no_memory_is_refused(content: bytes, said: str) -> None:
    with pytest.raises(InputError, match=said):
        decode(read_memory(content))


def test_a_sheet_that_ends_within_a_field_is_refused() -> None:
    whole = read_memory(bytes.fromhex(FOREIGN_PAGES))
    with pytest.raises(InputError, match=r"ends at bit 160, within 'electrical value at the low"):
        decode(whole[:20])


def test_an_unknown_template_is_named_and_kept() -> None:
    writer = BitWriter()
    writer.put(int.from_bytes(encode(Sheet(BASIC_VALUES))[:8], "little"), 64)
    writer.put(0, 2)
    writer.put(25, 8)
    writer.put(0b1011, 5)
    sheet = decode(writer.data())
    assert sheet.unread is not None
    assert sheet.unread.why == "template 25 of the standard"
    assert encode(sheet) == writer.data()


BASIC_VALUES = {"manufacturer": 31, "model": 1, "version_letter": "A", "version": 2, "serial": 3}


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"manufacturer": 16}, "basic sheet, manufacturer: 16; allowed: .* from 17 to 16381"),
        ({"serial": 2**24}, "serial: 16777216"),
        ({"serial": True}, "serial: True"),
        ({"version_letter": "a"}, "version_letter: 'a'"),
        ({"colour": 1}, "basic sheet with colour"),
    ],
)
def test_values_that_the_bits_cannot_hold_are_refused(changed: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=said):
        encode(Sheet({**BASIC_VALUES, **changed}))


def test_a_missing_value_is_named() -> None:
    with pytest.raises(InputError, match="calibration curve without segments"):
        encode(
            Sheet(
                BASIC_VALUES,
                (
                    Section(
                        41,
                        {
                            "domain": "physical",
                            "calibration_date": None,
                            "calibration_initials": "",
                            "calibration_period_days": 0,
                        },
                    ),
                ),
            )
        )


def test_a_sheet_that_is_longer_than_the_memory_is_refused() -> None:
    with pytest.raises(InputError, match=r"31 bytes in a memory of 32"):
        write_memory(bytes(32), 32)


def test_ranges_of_numbers_are_those_of_the_published_overview() -> None:
    # (first, last) of the fields: 18 bits 1 to 26.2k, 9 bits 0.1 to 51.1, 6 bits 1e-6 to 7.9
    assert Constant(18, 1.0, 0.1).end == pytest.approx(26.2e3, rel=1e-3)
    assert Constant(9, 0.1, 0.1).end == pytest.approx(51.1)
    last = Logarithmic(6, 1e-6, 0.146).decode(62)
    assert last is not None
    assert math.isclose(last, 7.9, rel_tol=0.01)
