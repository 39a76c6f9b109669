import io
import re
from functools import cache
from pathlib import Path

import numpy as np
import pypdf
import pytest

from torquebench.calibration import summarise_errors
from torquebench.figures import (
    Curve,
    additional_torque_figure,
    error_figure,
    friction_figure,
    group_figure,
    staircase_figure,
)
from torquebench.reducers import CertifiedFriction, check_friction
from torquebench.reports.errors_table import errors_table, number
from torquebench.reports.page import Facts, Figure, Page, Section, Table, render_page, write_page
from torquebench.reports.page_pdf import page_pdf
from torquebench.reports.reducers.standard import friction_diagram


@cache
def _figures() -> dict[str, str]:
    rng = np.random.default_rng(3)
    torque = np.linspace(-50.0, 50.0, 40)
    noise = rng.normal(0.0, 0.02, 40)
    branch = np.where(np.arange(40) % 2, 1, -1)
    curve = Curve("physics + Gaussian process", torque, noise)
    raw = Curve("raw reading", torque, 10 * noise, raw=True)
    speed = np.repeat([-600.0, -100.0, 100.0, 600.0], 3)
    return {
        "additional": additional_torque_figure(torque, noise, branch, [curve], 50.0),
        "error": error_figure([raw, curve], 50.0, limit_fs=0.001),
        "groups": group_figure({"hybrid": np.abs(noise[:10])}, 50.0, limit_fs=0.001),
        "staircase": staircase_figure(np.arange(40) / 2, torque, noise, 50.0),
        "friction": friction_figure(speed, speed * 1e-3, np.tile([1, 2, 3], 4), fit=curve),
    }


def test_the_same_arrays_give_the_same_bytes() -> None:
    assert _figures() == _figures.__wrapped__()


@pytest.mark.parametrize("name", ["additional", "error", "groups", "staircase", "friction"])
def test_figures_are_whole_svg_elements_without_outside_references(name: str) -> None:
    svg = _figures()[name]
    assert svg.startswith("<svg")
    assert svg.rstrip().endswith("</svg>")
    outside = [ref for ref in re.findall(r'(?:href|src)="([^"]*)"', svg) if ref[0] != "#"]
    assert outside == []


def _page(simulated: bool) -> Page:
    figure = Figure(_figures()["error"], "Errors of a < b & c.")
    table = Table(["model", "worst, N·m"], [["raw", "1.2"], ["hybrid", "0.1"]], "Caption.", 1)
    facts = Facts([("Transducer", "<script>alert(1)</script>")])
    return Page("Title", "subtitle", [Section("Part", "Text.", [facts, table, figure])], simulated)


def test_text_is_escaped_and_figures_are_not() -> None:
    html = render_page(_page(simulated=False))
    assert "<script" not in html
    assert "Errors of a &lt; b &amp; c." in html
    assert "<svg" in html
    assert html.count('class="emphasised"') == 1


def test_a_simulated_page_says_so_at_both_ends() -> None:
    assert render_page(_page(simulated=True)).count("simulated") >= 2
    assert "simulated" not in render_page(_page(simulated=False))


def test_a_page_needs_no_network() -> None:
    html = render_page(_page(simulated=True))
    assert not re.search(r'(?:href|src)="https?:', html)
    assert "@import" not in html


def test_a_page_appears_whole_and_leaves_no_part_behind(tmp_path: Path) -> None:
    path = write_page(_page(simulated=True), tmp_path / "new" / "report.html")
    assert path.read_text(encoding="utf-8").rstrip().endswith("</html>")
    assert [file.name for file in path.parent.iterdir()] == ["report.html"]


def test_a_page_that_fails_leaves_the_old_report_alone(tmp_path: Path) -> None:
    path = write_page(_page(simulated=True), tmp_path / "report.html")
    before = path.read_bytes()
    broken = Page("Title", "", [Section("Part", "", [Facts([("one",)])])])  # type: ignore[list-item]
    with pytest.raises(ValueError, match="unpack"):
        write_page(broken, path)
    assert path.read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == ["report.html"]


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0456, "0.0456"), (12.345, "12.3"), (1234.5, "1230"), (0.09999, "0.100"), (None, "–")],
)
def test_numbers_keep_their_significant_digits(value: float | None, text: str) -> None:
    assert number(value) == text


def test_the_errors_table_names_units_and_the_rule_for_readings() -> None:
    summary = summarise_errors([49.9, 0.1], [50.0, 0.0], 50.0)
    table = errors_table([("raw", summary)], "On two points.")
    assert list(table.rows[0])[1] == "0.100"
    assert "5 % of full scale" in table.caption
    assert [cell for cell in table.header if "% FS" in cell]


def _words_of_pdf(table: Table, rows_above: int = 0) -> list[list[tuple[str, float]]]:
    """Return every page's words with their abscissas in points."""
    above = Table(["a", "b"], [["1", "2"]] * rows_above, "Above.")
    sections = [Section("Part", "", [above] if rows_above else []), Section("Next", "", [table])]
    document = page_pdf(Page("Title", "", sections))
    return [_placed(sheet) for sheet in pypdf.PdfReader(io.BytesIO(document)).pages]


def _placed(sheet: pypdf.PageObject) -> list[tuple[str, float]]:
    words: list[tuple[str, float]] = []

    def keep(text: str, moved: list[float], placed: list[float], _font: object, _s: float) -> None:
        if text.strip():
            words.append((text.strip(), placed[4] * moved[0] + moved[4]))

    sheet.extract_text(visitor_text=keep)
    return words


def test_wide_headings_in_a_pdf_leave_the_first_column_its_place() -> None:
    header = [
        "group",
        "raw reading, N·m",
        *(f"a model with a long name {k}, N·m" for k in range(5)),
    ]
    (words,) = _words_of_pdf(Table(header, [["1", *["0.0123 / 0.0045"] * 6]] * 3))
    (group,) = (x for word, x in words if word.startswith("group"))
    (raw,) = (x for word, x in words if word.startswith("raw"))
    assert raw - group > 30.0


def test_sentences_in_a_pdf_get_more_room_than_short_names() -> None:
    rows = [["7. A cantilever support against a hollow cylinder", "long " * 40, "met"]]
    (words,) = _words_of_pdf(Table(["item", "what the papers say", "verdict"], rows, words=True))
    (papers,) = (x for word, x in words if word.startswith("what the"))
    (verdict,) = (x for word, x in words if word == "verdict")
    assert verdict - papers > 250.0


def test_a_short_table_in_a_pdf_is_not_divided_between_pages() -> None:
    pages = _words_of_pdf(Table(["place", "value"], [["row", "1"]] * 12, "Below it."), 36)
    with_rows = [number for number, words in enumerate(pages) if any("row" in w for w, _ in words)]
    with_caption = [number for number, words in enumerate(pages)
                    if any("Below" in w for w, _ in words)]  # fmt: skip
    assert len(pages) > 1
    assert with_rows == with_caption == [len(pages) - 1]


def test_the_friction_of_a_standard_reducer_is_drawn_with_its_error() -> None:
    known = tuple(
        CertifiedFriction(speed_rpm=rpm, torque_nm=0.3, expanded_uncertainty_nm=0.01)
        for rpm in (100.0, 600.0)
    )
    speed, repeat = np.tile([100.0, 600.0], 2), np.repeat([1, 2], 2)
    check = check_friction(speed, np.array([0.31, 0.3, 0.3, 0.29]), repeat, known, 50.0, 0.1)
    svg = friction_diagram(check).svg
    assert svg.count('id="axes_') >= 2
    assert 'id="FillBetweenPolyCollection_1"' in svg
