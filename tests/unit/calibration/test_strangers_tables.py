"""Tables of other laboratories against a computation by the formulas alone, without the package.

The tables in `field` are shaped after public reports; the others are drawn at random, one kind of
layout each. `judged` evaluates the description that a table is written from: it never reads one.
"""

from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from math import sqrt
from pathlib import Path
from statistics import fmean

import numpy as np
import pytest
from tests.support.draws import some
from tests.support.tables import parse_calibration

from torquebench.calibration import (
    CalibrationResults,
    DirectionResults,
    calibration_results,
    find_deviations,
    load_profile,
    loading_series,
    own_steps,
    tare,
)
from torquebench.calibration.deviations import CalibrationRecord, assign_nominal
from torquebench.tables import read_calibration
from torquebench.uncertainty import CertifiedUncertainty

FIELD = Path(__file__).parent / "field"
REFERENCE = CertifiedUncertainty.of_torque(1e-4)
RESOLUTION = 0.01
TABLES = 20
CLASSES = (0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)


def of_file(name: str, constant: float = 0.0) -> CalibrationResults:
    (path,) = FIELD.glob(f"{name}_*.csv")
    data = read_calibration(path)
    data = replace(data, reading_nm=data.reading_nm + constant)
    return calibration_results(data, resolution_nm=RESOLUTION, reference=REFERENCE)


def only(results: CalibrationResults) -> DirectionResults:
    (direction,) = results.directions
    return direction


def test_series_beyond_the_second_count() -> None:
    side = only(of_file("f5")).before
    assert side.columns["f_q"] == pytest.approx([1.0, 1.0])
    assert side.columns["b′"] == pytest.approx([1.980198] * 2)
    assert np.all(side.expanded_percent >= 1.1)


def test_an_extra_series_of_a_position_counts() -> None:
    side = only(of_file("f5b")).before
    assert side.columns["b′"] == pytest.approx([1.980198] * 2)
    assert side.columns["f_q"] == pytest.approx([1 / 3] * 2)
    assert side.classification is not None
    assert side.classification.whole_range == 5.0


def test_the_zero_before_a_series_is_subtracted() -> None:
    side = only(of_file("f2")).before
    assert side.evaluation.zero_residual_percent == pytest.approx(100 * 0.3 / 99.7)
    assert side.columns["f_q"] == pytest.approx([-0.6, -0.3])
    assert side.classification is not None
    assert side.classification.whole_range == 2.0


@pytest.mark.parametrize("name", ["f1", "f1b", "f2", "f5", "f5b", "f6", "f7", "f9", "f11"])
@pytest.mark.parametrize("constant", [1.0, -0.37, 40.0])
def test_a_constant_added_to_every_reading_changes_no_figure(name: str, constant: float) -> None:
    as_read, shifted = of_file(name), of_file(name, constant)
    for one, other in zip(as_read.directions, shifted.directions, strict=True):
        for symbol, values in one.before.columns.items():
            changed = other.before.columns[symbol]
            assert (values is None) == (changed is None)
            if values is not None and changed is not None:
                np.testing.assert_allclose(changed, values, atol=1e-9)
        assert one.before.class_words == other.before.class_words
    assert shifted.errors_before.worst_nm == pytest.approx(as_read.errors_before.worst_nm)


@pytest.mark.parametrize("name", ["f1", "f1b"])
def test_series_of_unequal_length_are_evaluated(name: str) -> None:
    side = only(of_file(name)).before
    assert side.evaluation.torque_nm.tolist() == [50.0, 100.0]
    assert side.columns["b′"] == pytest.approx([0.02, 0.01], abs=1e-4)
    data = read_calibration(next(FIELD.glob(f"{name}_*.csv")))
    profile = load_profile("rapid-in-situ")
    record = CalibrationRecord(assign_nominal(data, profile), datetime.now(UTC))
    assert find_deviations(record, profile)


def test_the_range_is_that_of_the_nominal_torques() -> None:
    data = read_calibration(next(FIELD.glob("f7_*.csv")))
    assert data.range_nm == 100.0
    profile = load_profile("staircase")
    record = CalibrationRecord(assign_nominal(data, profile), datetime.now(UTC))
    found = {each.kind for each in find_deviations(record, profile)}
    assert found == {"expired_reference"}


def test_limits_are_compared_as_they_are_stated() -> None:
    side = only(of_file("f9")).before
    assert side.columns["f_q"][0] > 0.05  # by 2e-15 only
    assert side.classification is not None
    assert side.classification.whole_range == 0.1


def test_rows_are_numbered_as_the_file_numbers_them() -> None:
    data = read_calibration(next(FIELD.glob("f10_*.csv")))
    assert data.row is not None
    assert data.row[data.reading_nm == 2.1].tolist() == [5]


# ---- random tables ----------------------------------------------------------------------------


@dataclass
class Series:
    """A rise and perhaps a fall, as (nominal, standard, reading) in measuring order."""

    position: float
    rise: list[tuple[float, float, float]]
    fall: list[tuple[float, float, float]] = field(default_factory=list)
    zero: float | None = None
    final: float | None = None


def judged(  # noqa: C901 - one formula after another
    series: list[Series],
) -> dict[str, list[float | None] | float | None]:
    """Evaluate by the formulas; zeros that weren't read before a series aren't allowed here."""
    steps = sorted({nominal for one in series for nominal, _, _ in one.rise})

    def deflections(points: list[tuple[float, float, float]], zero: float) -> dict[float, float]:
        return {
            nominal: (reading - zero) * nominal / standard for nominal, standard, reading in points
        }

    zeros = [one.zero or 0.0 for one in series]
    up = [deflections(one.rise, zero) for one, zero in zip(series, zeros, strict=True)]
    down = [deflections(one.fall, zero) for one, zero in zip(series, zeros, strict=True)]
    positions = list(dict.fromkeys(one.position for one in series))
    members = {p: [k for k, one in enumerate(series) if one.position == p] for p in positions}
    standard_layout = len(positions) > 1 and len(members[positions[0]]) == 2

    mean, repeat, reproduced, reversed_, w = [], [], [], [], []
    for step in steps:
        of_position = []
        for p in positions:
            counted = members[p]
            if standard_layout and p == positions[0]:
                counted = counted[:1]
            values = [up[k][step] for k in counted if step in up[k]]
            if values:
                of_position.append(fmean(values))
        if not of_position:  # only the repeat has it
            of_position = [up[members[positions[0]][1]][step]]
        mean.append(fmean(of_position))
        spreads = []
        for p in positions:
            values = [up[k][step] for k in members[p] if step in up[k]]
            if len(values) > 1:
                spreads.append(100 * (max(values) - min(values)) / fmean(values))
        repeat.append(max(spreads) if spreads else None)
        several = len(of_position) > 1
        reproduced.append(
            100 * (max(of_position) - min(of_position)) / mean[-1] if several else None
        )
        falls = []
        for k, one in enumerate(series):
            if not one.fall:
                continue
            top = max(up[k])
            lower = down[k].get(step, up[k][step] if step == top else None)
            if lower is not None:
                falls.append(abs(lower - up[k].get(step, mean[-1])))
        reversed_.append(100 * fmean(falls) / mean[-1] if falls else None)
    returned = [
        abs(one.final - zero)
        for one, zero in zip(series, zeros, strict=True)
        if one.final is not None
    ]
    residual = 100 * max(returned) / mean[-1] if returned else None
    degree = min(3, len(steps) - 1)
    powers = np.array([[(m / steps[-1]) ** k for k in range(1, degree + 1)] for m in steps])
    curve = powers @ np.linalg.solve(powers.T @ powers, powers.T @ np.array(mean))
    deviation = [100 * (x - a) / a for x, a in zip(mean, curve, strict=True)]

    def at(values: list[float | None], k: int) -> float:
        known = [value for value in values if value is not None]
        if not known:
            return 0.0
        value = values[k]
        return max(known) if value is None else value

    for k, _ in enumerate(steps):
        r = 100 * RESOLUTION / mean[k]
        parts = [
            0.01 / 2,
            r / sqrt(12),
            r / sqrt(12),
            deviation[k] / sqrt(6),
            at(repeat, k) / sqrt(12),
            at(reproduced, k) / sqrt(8),
            (residual or 0.0) / sqrt(12),
            at(reversed_, k) / sqrt(12),
        ]
        w.append(2 * sqrt(sum(part**2 for part in parts)))
    return {
        "steps": steps,
        "f_q": [100 * (x - m) / m for x, m in zip(mean, steps, strict=True)],
        "b′": repeat,
        "b": reproduced,
        "h": reversed_,
        "f_a": deviation,
        "W": w,
        "f₀": residual,
    }


def written(series: list[Series], *, nominal: bool, numbered: bool = True) -> str:
    rows = [["position_deg", "nominal_nm", "standard_nm", "reading_nm"]]
    if numbered:
        rows[0].append("series")
    for number, one in enumerate(series, 1):
        points = [(0.0, 0.0, one.zero)] if one.zero is not None else []
        points += [*one.rise, *one.fall]
        if one.final is not None:
            points.append((0.0, 0.0, one.final))
        for point in points:
            rows.append([repr(one.position), *(repr(float(value)) for value in point)])
            if numbered:
                rows[-1].append(str(number))
    if not nominal:
        rows = [[cell for k, cell in enumerate(row) if k != 1] for row in rows]
    return "\n".join(",".join(row) for row in rows) + "\n"


def drawn(
    rng: np.random.Generator,
    positions: list[float],
    steps: list[list[float]],
    *,
    falling: list[bool],
    off: float = 0.0,
    zero: float = 0.0,
) -> list[Series]:
    """Draw the series of an imperfect chain: span, curvature, hysteresis, positions, noise."""
    top = max(max(each) for each in steps)
    span, bend, loop = rng.normal(0, 0.01), rng.normal(0, 0.003), rng.normal(0, 0.003)
    turned = {p: rng.normal(0, 0.002) for p in positions}
    series = []
    for position, rise, falls in zip(positions, steps, falling, strict=True):
        own_zero = zero * rng.normal() if zero else 0.0

        def point(
            nominal: float, branch: int, own_zero: float = own_zero, position: float = position
        ) -> tuple[float, float, float]:
            standard = nominal * (1 + off * rng.uniform(-1, 1))
            u = standard / top
            error = span + turned[position] + bend * u + loop * (branch < 0) * (1 - u)
            reading = standard * (1 + error) + own_zero + 1e-4 * top * rng.normal()
            return nominal, standard, reading

        up = [point(nominal, 1) for nominal in sorted(rise)]
        down = [point(nominal, -1) for nominal in sorted(rise)[-2::-1]] if falls else []
        final = own_zero + 3e-4 * top * rng.normal() if falls else None
        series.append(Series(position, up, down, own_zero, final))
    return series


STEPS = [10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 80.0, 100.0]


def hidden_zero(rng: np.random.Generator) -> tuple[list[Series], bool]:
    return drawn(
        rng, [0.0, 0.0, 120.0, 240.0], [STEPS] * 4, falling=[False, False, True, True], zero=3.0
    ), True


def extra_series(rng: np.random.Generator) -> tuple[list[Series], bool]:
    positions = sorted(rng.choice([0.0, 60.0, 120.0, 180.0, 240.0], rng.integers(2, 9)).tolist())
    falling = (rng.random(len(positions)) < 0.5).tolist()
    return drawn(rng, positions, [STEPS] * len(positions), falling=falling, zero=0.2), True


def unequal_steps(rng: np.random.Generator) -> tuple[list[Series], bool]:
    count = int(rng.integers(2, 7))
    positions = [[0.0, 0.0, 120.0, 240.0, 120.0, 240.0][k] for k in range(count)]
    steps = [
        sorted({*rng.choice(STEPS[:-1], rng.integers(2, 7), replace=False).tolist(), 100.0})
        for _ in range(count)
    ]
    return drawn(rng, positions, steps, falling=(rng.random(count) < 0.5).tolist(), zero=0.1), True


def measured_steps(rng: np.random.Generator) -> tuple[list[Series], bool]:
    """A reference transducer misses every step by up to 0.4 %; the table has no nominal torques."""
    return drawn(
        rng, [0.0, 0.0, 120.0], [STEPS] * 3, falling=[False, True, True], off=0.004, zero=0.5
    ), False


def missed_steps(rng: np.random.Generator) -> tuple[list[Series], bool]:
    """Hand-loaded steps, up to 6 % off the nominal torques that the table states."""
    return drawn(rng, [0.0, 0.0], [STEPS] * 2, falling=[True, True], off=0.06, zero=0.5), True


def one_position(rng: np.random.Generator) -> tuple[list[Series], bool]:
    count = int(rng.integers(1, 7))
    return drawn(rng, [0.0] * count, [STEPS] * count, falling=[True] * count, zero=0.2), True


def few_steps(rng: np.random.Generator) -> tuple[list[Series], bool]:
    steps = [*sorted(rng.choice(STEPS[:-1], rng.integers(1, 3), replace=False).tolist()), 100.0]
    return drawn(rng, [0.0, 0.0, 90.0], [steps] * 3, falling=[False, False, True]), True


KINDS = [
    hidden_zero, extra_series, unequal_steps, measured_steps, missed_steps, one_position, few_steps,
]  # fmt: skip


@pytest.mark.parametrize("kind", some(KINDS, by_day=4), ids=lambda each: each.__name__)
def test_random_tables_agree_with_the_formulas(kind) -> None:
    for seed in range(TABLES):
        rng = np.random.default_rng([seed, len(kind.__name__)])
        series, nominal = kind(rng)
        expected = judged(series)
        data = parse_calibration(written(series, nominal=nominal), "a table")
        if kind is missed_steps:
            expected["steps"] = STEPS
        results = calibration_results(data, resolution_nm=RESOLUTION, reference=REFERENCE)
        side = only(results).before
        assert side.evaluation.torque_nm.tolist() == expected["steps"], seed
        for symbol in ("f_q", "b′", "b", "h", "f_a", "W"):
            compared = side.columns[symbol]
            wanted = [np.nan if value is None else value for value in expected[symbol]]
            if compared is None:
                compared = np.full(len(wanted), np.nan)
            np.testing.assert_allclose(
                compared, wanted, rtol=1e-6, atol=1e-7, err_msg=f"{symbol}, seed {seed}"
            )
        residual = side.evaluation.zero_residual_percent
        assert (residual is None) == (expected["f₀"] is None)
        if residual is not None:
            assert residual == pytest.approx(expected["f₀"])


def test_classes_follow_from_the_stated_quantities() -> None:
    """Every stated quantity, rounded as printed, against the limits of every class."""
    for seed in range(TABLES):
        rng = np.random.default_rng([seed, 77])
        scale = 10 ** rng.uniform(-3, 0)
        series = drawn(rng, [0.0, 0.0, 120.0], [STEPS] * 3, falling=[False, True, True])
        for one in series:  # from a perfect chain to a bad one
            one.rise = [(m, s, s + scale * (x - s)) for m, s, x in one.rise]
            one.fall = [(m, s, s + scale * (x - s)) for m, s, x in one.fall]
            one.final = None if one.final is None else scale * one.final
        data = parse_calibration(written(series, nominal=True), "a table")
        side = only(calibration_results(data, resolution_nm=0.001, reference=REFERENCE)).before
        assert side.classification is not None
        shown = {
            symbol: [abs(round(float(value), 4)) for value in values]
            for symbol, values in side.columns.items()
            if values is not None
        }
        residual = round(side.evaluation.zero_residual_percent or 0.0, 4)
        met = []
        for c in CLASSES:
            h = {0.05: 0.063, 0.5: 0.63}.get(c, 1.25 * c)
            limits = {"f_q": c / 2, "b′": c / 2, "b": c, "h": h, "r": c / 2}
            if (
                residual <= c / 4
                and c / 5 >= 0.01
                and all(value <= limits[symbol] for symbol in limits for value in shown[symbol])
            ):
                met.append(c)
        assert side.classification.whole_range == min(met, default=None), seed


def test_repeated_cycles_without_a_number_are_series() -> None:
    for seed in range(TABLES):
        rng = np.random.default_rng([seed, 5])
        count = int(rng.integers(2, 6))
        series = drawn(rng, [0.0] * count, [STEPS] * count, falling=[True] * count, zero=0.3)
        numbered, bare = (
            parse_calibration(written(series, nominal=False, numbered=numbered), "a table")
            for numbered in (True, False)
        )
        assert bare.series.tolist() == numbered.series.tolist()


def test_both_directions_count_from_their_own_zeros() -> None:
    for seed in range(TABLES):
        rng = np.random.default_rng([seed, 9])
        right, left = (drawn(rng, [0.0], [STEPS], falling=[True], zero=1.0)[0] for _ in range(2))
        mirrored = Series(
            0.0,
            [(-m, -s, -x) for m, s, x in left.rise],
            [(-m, -s, -x) for m, s, x in left.fall],
            -(left.zero or 0.0),
            -(left.final or 0.0),
        )
        data = parse_calibration(written([right, mirrored], nominal=True), "a table")
        results = calibration_results(data, resolution_nm=RESOLUTION, reference=REFERENCE)
        for direction, one in zip(results.directions, (right, left), strict=True):
            np.testing.assert_allclose(direction.before.columns["f_q"], judged([one])["f_q"])


@pytest.mark.parametrize(
    ("largest", "expected"), [(100.0, 100.0), (99.97, 100.0), (1.0004e6, 1e6), (93.7, 93.7)]
)
def test_the_range_is_never_guessed_from_a_reading(largest: float, expected: float) -> None:
    for seed in range(TABLES):
        gain = np.random.default_rng(seed).uniform(0.8, 1.3)
        text = "reading_nm,standard_nm\n" + "".join(
            f"{gain * share * largest!r},{share * largest!r}\n" for share in (0.3, 0.6, 1.0)
        )
        assert parse_calibration(text, "a table").range_nm == pytest.approx(expected)


def test_a_regression_is_the_textbook_s() -> None:
    for seed in range(TABLES):
        rng = np.random.default_rng([seed, 3])
        series = drawn(rng, [0.0, 0.0], [STEPS] * 2, falling=[True, True], zero=0.5)
        data = parse_calibration(written(series, nominal=True), "a table")
        results = calibration_results(data, resolution_nm=RESOLUTION, reference=REFERENCE)
        line = results.regression["all points"]
        x, y = data.standard_nm, tare(data).data.reading_nm
        design = np.stack([x, np.ones_like(x)], axis=1)
        (slope, intercept), squares, *_ = np.linalg.lstsq(design, y, rcond=None)
        assert (line.slope, line.intercept) == pytest.approx((slope, intercept))
        assert line.see == pytest.approx(np.sqrt(squares[0] / (x.size - 2)))
        assert line.r_squared == pytest.approx(np.corrcoef(x, y)[0, 1] ** 2)


def test_what_is_left_out_is_named() -> None:
    text = (
        "series,branch,nominal_nm,standard_nm,reading_nm\n"
        "1,up,0,0,0\n1,up,20,20,20\n1,up,50,50,50\n1,up,100,100,100\n1,down,30,30,30\n"
        "1,down,0,0,0\n2,up,20,26,26\n2,up,50,50,50\n2,up,100,103,103\n"
    )
    loading = loading_series(own_steps(parse_calibration(text, "a table", range_nm=110.0)), 1)
    assert loading is not None
    assert loading.torque_nm.tolist() == [20.0, 50.0, 100.0]
    reduced, far, falling = loading.remarks
    assert "100 N·m of series 2 was loaded with 103 N·m, deviation 3 %: reduced" in reduced
    assert "20 N·m of series 2 was loaded with 26 N·m, deviation 30 %: left out" in far
    assert "without increasing torque: 30 N·m" in falling


def test_a_ramp_is_named_and_the_other_direction_evaluated() -> None:
    ramp = "".join(f"{value},{value}\n" for value in np.linspace(0.0, 100.0, 500))
    steps = "".join(f"{-value},{-value}\n" for value in (0.0, 20.0, 40.0, 100.0))
    data = parse_calibration("reading_nm,standard_nm\n" + ramp + steps, "a table")
    results = calibration_results(data, resolution_nm=RESOLUTION, reference=REFERENCE)
    assert only(results).name == "counter-clockwise"
    assert any("different torques are a ramp" in remark for remark in results.remarks)
