"""Torsion of sections: closed forms against the table, finite elements against closed forms."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from torquebench.errors import InputError
from torquebench.mechanics import (
    annulus,
    circle,
    closed_curve,
    equal_area_twist_ratio,
    hollow_circle_gain,
    polygon,
    rectangle,
    rectangle_torsion_constant,
    rectangle_torsion_factor,
    rectangles,
    section_torsion,
    shaft_twist,
    spline_shaft,
)

# Timoshenko's table: a/b, β_s, twist by that of a circle of the same area; rounded as printed.
TABLE = [
    (1.0, 0.1406, 1.132),
    (1.5, 0.1958, 1.220),
    (2.0, 0.2287, 1.392),
    (3.0, 0.2633, 1.813),
    (5.0, 0.2913, 2.732),
    (10.0, 0.3123, 5.096),
    (20.0, 0.3228, 9.860),
]


@pytest.mark.parametrize(("ratio", "factor", "twist"), TABLE)
def test_closed_form_reproduces_the_table(ratio, factor, twist):
    assert float(rectangle_torsion_factor(ratio)) == pytest.approx(factor, abs=0.51e-4)
    assert float(equal_area_twist_ratio(ratio)) == pytest.approx(twist, abs=0.51e-3)


@pytest.mark.parametrize(("ratio", "factor", "twist"), TABLE)
def test_finite_elements_reproduce_the_table_to_1e_5(ratio, factor, twist):
    torsion = section_torsion(rectangle(ratio, 1.0))
    exact = float(rectangle_torsion_constant(ratio, 1.0))
    assert torsion.torsion_constant_m4 == pytest.approx(exact, rel=1e-5)
    assert torsion.lower_m4 <= exact * (1 + 1e-12)
    assert torsion.upper_m4 >= exact * (1 - 1e-12)
    assert torsion.torsion_constant_m4 / ratio == pytest.approx(factor, abs=0.6e-4)


def test_the_sum_is_exact():
    n = np.arange(1, 20001, 2, dtype=np.float64)
    for ratio in (1.0, 1.3, 7.0):
        series = np.sum(np.tanh(n * np.pi * ratio / 2) / n**5)
        direct = (1 - 192 / (np.pi**5 * ratio) * series) / 3
        assert float(rectangle_torsion_factor(ratio)) == pytest.approx(direct, rel=1e-13)
    assert float(rectangle_torsion_factor(1e9)) == pytest.approx(1 / 3, rel=1e-8)


@given(ratio=st.floats(1.0, 100.0))
def test_twist_of_equal_area_is_the_ratio_of_both_formulas(ratio):
    side = np.sqrt(ratio)
    rectangular = 10.0 / (rectangle_torsion_constant(side, 1.0 / side) * 79e9)
    circular = shaft_twist(10.0, 1.0, 79e9, 2.0 / np.sqrt(np.pi))
    assert float(rectangular / circular) == pytest.approx(float(equal_area_twist_ratio(ratio)))
    assert float(equal_area_twist_ratio(ratio)) > 1.0


@pytest.mark.parametrize("ratio", [0.0, 0.3, 0.6, 0.9])
def test_hollow_circle_by_finite_elements(ratio):
    tube = section_torsion(annulus(1.0, ratio))
    rod = section_torsion(circle(np.sqrt(1.0 - ratio**2)))
    assert tube.torsion_constant_m4 == pytest.approx(np.pi / 32 * (1 - ratio**4), rel=1e-4)
    gain = tube.torsion_constant_m4 / rod.torsion_constant_m4
    assert gain == pytest.approx(float(hollow_circle_gain(ratio)), rel=1e-4)


def test_a_hole_is_not_a_slit():
    thickness = 0.02
    outer = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
    inner = 0.5 + (1 - 2 * thickness) * (outer - 0.5)
    closed = section_torsion(polygon(outer, [inner]))
    bredt = (1 - thickness) ** 3 * thickness  # 4 A² t / perimeter of the middle line
    assert closed.torsion_constant_m4 == pytest.approx(bredt, rel=0.02)
    gap = 0.01
    slit = section_torsion(
        rectangles(
            [
                (0, 0, 1, thickness),
                (0, 1 - thickness, 1, 1),
                (0, 0, thickness, 1),
                (1 - thickness, 0, 1, 0.5 - gap / 2),
                (1 - thickness, 0.5 + gap / 2, 1, 1),
            ]
        )
    )
    length = 4 * (1 - thickness) - gap
    assert slit.torsion_constant_m4 == pytest.approx(length * thickness**3 / 3, rel=0.03)


def test_two_cells_by_bredt_and_batho():
    # Symmetric twin-cell box: no flow in the middle wall, so it acts as one cell.
    thickness, half = 0.01, 0.005
    outer = [(0.0, 0.0, 2.0, thickness), (0.0, 1 - thickness, 2.0, 1.0)]
    walls = [(0.0, 0.0, thickness, 1.0), (2 - thickness, 0.0, 2.0, 1.0)]
    box = rectangles([*outer, *walls, (1 - half, 0.0, 1 + half, 1.0)])
    assert len(box.loops) == 3
    width, height = 2 - thickness, 1 - thickness
    one_cell = 4 * (width * height) ** 2 * thickness / (2 * (width + height))
    torsion = section_torsion(box)
    assert torsion.torsion_constant_m4 == pytest.approx(one_cell, rel=0.02)
    assert torsion.lower_m4 < torsion.upper_m4


def test_separate_parts_add_up():
    pair = section_torsion(rectangles([(0, 0, 2, 1), (5, 0, 7, 1)]))
    assert pair.torsion_constant_m4 == pytest.approx(
        2 * float(rectangle_torsion_constant(2.0, 1.0)), rel=1e-5
    )


def test_equilateral_triangle_and_ellipse():
    triangle = section_torsion(polygon([[0, 0], [1, 0], [0.5, np.sqrt(3) / 2]]))
    assert triangle.torsion_constant_m4 == pytest.approx(np.sqrt(3) / 80, rel=1e-6)
    angle = np.linspace(0, 2 * np.pi, 30, endpoint=False)
    points = np.column_stack((2 * np.cos(angle), np.sin(angle)))
    ellipse = section_torsion(closed_curve(points, segments=240))
    assert ellipse.torsion_constant_m4 == pytest.approx(np.pi * 8 / 5, rel=5e-4)


def test_spline_shaft_lies_between_its_circles():
    shaft = section_torsion(spline_shaft(0.032, 0.026, 6, 0.006))
    assert np.pi * 0.026**4 / 32 < shaft.lower_m4
    assert shaft.upper_m4 < shaft.polar_moment_m4 < np.pi * 0.032**4 / 32
    assert shaft.upper_m4 / shaft.lower_m4 < 1.01
    bored = section_torsion(spline_shaft(0.032, 0.026, 6, 0.006, bore_m=0.010))
    lost = shaft.torsion_constant_m4 - bored.torsion_constant_m4
    assert lost == pytest.approx(np.pi * 0.010**4 / 32, rel=0.1)


@settings(max_examples=12)
@given(
    angle=st.floats(0.0, 2 * np.pi),
    shift=st.tuples(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0)),
    scale=st.floats(1e-3, 10.0),
    turned=st.booleans(),
)
def test_torsion_moves_turns_and_scales_with_the_section(angle, shift, scale, turned):
    corners = np.array([[0, 0], [3, 0], [3, 1], [1, 1], [1, 2.5], [0, 2.5]])
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    moved = scale * (corners @ turn.T + np.array(shift))
    reference = section_torsion(polygon(corners), triangles=300)
    result = section_torsion(polygon(moved[::-1] if turned else moved), triangles=300)
    assert result.area_m2 == pytest.approx(scale**2 * reference.area_m2)
    assert result.polar_moment_m4 == pytest.approx(scale**4 * reference.polar_moment_m4, rel=1e-8)
    assert result.lower_m4 < scale**4 * reference.upper_m4
    assert scale**4 * reference.lower_m4 < result.upper_m4


@settings(max_examples=12)
@given(width=st.floats(0.2, 5.0), height=st.floats(0.2, 5.0), hole=st.floats(0.05, 0.9))
def test_bounds_enclose_and_tighten(width, height, hole):
    frame = polygon(
        [[0, 0], [width, 0], [width, height], [0, height]],
        [0.5 * np.array([width, height]) + hole * (np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]))
         * 0.5 * np.array([width, height])],
    )  # fmt: skip
    coarse, fine = section_torsion(frame, triangles=100), section_torsion(frame, triangles=1000)
    assert coarse.lower_m4 < fine.upper_m4
    assert fine.lower_m4 < coarse.upper_m4
    assert fine.upper_m4 - fine.lower_m4 <= 1.2 * (coarse.upper_m4 - coarse.lower_m4)
    assert fine.upper_m4 < fine.polar_moment_m4
    assert fine.upper_m4 / fine.lower_m4 < 1.02


def test_rectangles_unite():
    cross = rectangles([(1, 0, 2, 3), (0, 1, 3, 2)])
    assert cross.area_m2 == pytest.approx(5.0)
    assert len(cross.loops) == 1
    assert len(cross.loops[0]) == 12
    merged = rectangles([(0, 0, 1, 1), (1, 0, 2, 1), (0.5, 0, 1.5, 1)])
    assert len(merged.loops[0]) == 4
    assert merged.area_m2 == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: polygon([[0, 0], [1, 0]]), "at least 3 corners"),
        (lambda: polygon([[0, 0], [1, 0], [1, 1], [0, 0]]), "closing corner"),
        (lambda: polygon([[0, 0], [1, 0], [2, 0]]), "without area"),
        (lambda: polygon([[0, 0], [1, 0], [0, np.inf]]), "finite"),
        (lambda: rectangles([]), "at least one rectangle"),
        (lambda: rectangle(0.0, 1.0), "left < right"),
        (lambda: rectangles([(0, 0, 1, 1), (1, 1, 2, 2)]), "stay apart"),
        (lambda: annulus(1.0, 1.0), "inner < outer"),
        (lambda: spline_shaft(0.03, 0.026, 2, 0.006), "at least 3 teeth"),
        (lambda: spline_shaft(0.03, 0.026, 30, 0.006), "gaps between"),
        (lambda: closed_curve([[0, 0], [1, 0], [1, 1]]), "at least 4 points"),
        (lambda: section_torsion(rectangle(1, 1), triangles=3), "at least 20"),
        (lambda: section_torsion(polygon([[0, 0], [2, 0], [0, 1], [3, 2]])), "cross"),
        (
            lambda: section_torsion(
                polygon([[0, 0], [2, 0], [2, 2], [0, 2]], [[[1, 1], [3, 1], [3, 1.5], [1, 1.5]]])
            ),
            "cross",
        ),
        (lambda: rectangle_torsion_factor(0.5), "a/b >= 1"),
        (lambda: rectangle_torsion_constant(1.0, -1.0), "above 0"),
        (lambda: hollow_circle_gain(1.0), "0 <= d/D < 1"),
    ],
)
def test_impossible_sections_are_refused(build, message):
    with pytest.raises(InputError, match=message):
        build()
