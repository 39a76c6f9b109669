"""Items 4 to 7: additional torque of a chain's design, and stiffness of the supports."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import tau
from pathlib import Path
from types import MappingProxyType
from typing import Literal

import numpy as np

from torquebench.errors import InputError
from torquebench.figures import Curve
from torquebench.mechanics import (
    Chain,
    SupportComparison,
    SupportDesign,
    additional_torque,
    compare_supports,
    equal_area_twist_ratio,
    hollow_circle_gain,
    polar_moment,
    rectangle_torsion_constant,
    rectangle_torsion_factor,
    sensitivities,
)
from torquebench.message import Message
from torquebench.papers.items import Answer
from torquebench.papers.study import Contender, errors_of, studied_chain
from torquebench.reports.curve_figures import Panel, bodies_figure
from torquebench.reports.errors_table import number
from torquebench.reports.page import Block, Diagram, Facts, Figure, Table
from torquebench.validation import parse_toml

COAXIALITY_LIMIT_M = 0.03e-3
"""Limit of the coaxiality error by [J]."""
Blocks = list[Block]


@dataclass(frozen=True)
class Design:
    """A measuring chain's design and its torque range.

    Attributes
    ----------
    name : str
    range_nm : float
    chain : Chain
    """

    name: str
    range_nm: float
    chain: Chain


DESIGNS: Mapping[str, Design] = MappingProxyType(
    {
        "input": Design(
            "input module, example design",
            50.0,
            Chain(0.030, 0.010, 0.20, 79e9, 0.015, 2e-5, 1e-4, 5e7, 3.6e5, 1.25e4),
        ),
        "output": Design(
            "output module, example design",
            2000.0,
            Chain(0.090, 0.030, 0.30, 79e9, 0.045, 2e-5, 2e-4, 5e8, 1.5e7, 2.4e5),
        ),
    }
)
"""Example designs, because the papers don't publish dimensions and coefficients."""

_WORDS = {
    "outer_diameter_m": "outer diameter D",
    "inner_diameter_m": "inner diameter d",
    "length_m": "length L",
    "shear_modulus_pa": "shear modulus G",
    "shaft_radius_m": "radius r",
    "coaxiality_error_m": "coaxiality error Δr",
    "angular_misalignment_rad": "angular misalignment Δθ",
    "strain_coefficient_n_per_m": "strain coefficient ε",
    "elastic_coefficient_n_per_rad": "elastic coefficient μ",
    "radial_stiffness_n_per_m": "radial stiffness K_c",
}


_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def load_design(path: Path) -> Design:
    """Read a chain from a TOML file: `name`, `range_nm` and the fields of `mechanics.Chain`.

    Raises
    ------
    InputError
        A key is missing or unknown, or its value isn't a number.
    """
    try:
        content = dict(parse_toml(path.read_text(encoding="utf-8"), str(path)))
    except UnicodeDecodeError as error:
        raise InputError(Message("{path}: {error}", path, error), "a TOML file in UTF-8") from error
    name = str(content.pop("name", path.stem))
    allowed = ("range_nm", *_WORDS)
    for key in content:
        if key not in allowed:
            raise InputError(Message("{path}: key {key}", path, key), ", ".join(("name", *allowed)))
    for key in allowed:
        value = content.get(key)
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise InputError(
                Message("{path}: {key} = {value!r}", path, key, value),
                "a number in SI units",
                "give all keys",
            )
    range_nm = float(content.pop("range_nm"))
    if not 0.0 < range_nm < np.inf:
        raise InputError(
            Message("{path}: range_nm = {range_nm:g}", path, range_nm), "a finite range above 0 N·m"
        )
    return Design(name, range_nm, Chain(**{key: float(each) for key, each in content.items()}))


def coaxiality_effect_nm(design: Design) -> float:
    """Return the change of torque at full scale, N·m, by a coaxiality error at the limit of [J]."""
    errors = (0.0, COAXIALITY_LIMIT_M)
    without, limit = (
        additional_torque(replace(design.chain, coaxiality_error_m=each), design.range_nm).total_nm
        for each in errors
    )
    return float(limit - without)


def _odd(
    design: Design, form: Literal["consistent", "published"]
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Return torques over ±range and the additional torque's parts, as odd functions of torque."""
    torque = np.linspace(-design.range_nm, design.range_nm, 401)
    parts = additional_torque(design.chain, np.abs(torque), form=form)
    names = ("bearing friction", "parallel misalignment", "angular misalignment", "sum")
    sign = np.where(torque < 0.0, -1.0, 1.0)
    return torque, {name: sign * part for name, part in zip(names, parts, strict=True)}


def _style(name: str) -> str:
    """Return a line style; the sum is dashed so that other curves remain visible below it."""
    return "--" if name == "sum" else "-"


def _scientific(value: float, digits: int = 3) -> str:
    """Return a value as text, with a power of ten if it is very large or small.

    Examples
    --------
    >>> _scientific(4.17e14), _scientific(-4.11e-9), _scientific(0.2)
    ('4.17×10¹⁴', '-4.11×10⁻⁹', '0.2')
    """
    mantissa, _, power = f"{value:.{digits}g}".partition("e")
    return f"{mantissa}×10{str(int(power)).translate(_RAISED)}" if power else mantissa


def additional_torque_blocks(design: Design) -> tuple[Answer, Blocks]:
    """Return figure and tables of additional torque, sensitivities and coaxiality limit."""
    torque, parts = _odd(design, "consistent")
    _, printed = _odd(design, "published")
    consistent = Panel(
        [Curve(name, torque, part, style=_style(name)) for name, part in parts.items()],
        "torque in N·m",
        "additional torque in N·m",
        range_nm=design.range_nm,
        title=Message("{name}: consistent form", design.name),
    )
    right = torque > 0.0
    as_printed = Panel(
        [
            Curve(name, torque[right], np.maximum(np.abs(part[right]), 1e-12), style=_style(name))
            for name, part in printed.items()
        ],
        "torque in N·m",
        "amount in N·m",
        logarithmic="y",
        title="as printed: eqs 7, 13, 14, 15 with their defects",
    )
    at_full = {name: float(part[-1]) for name, part in parts.items()}
    printed_at_full = {name: float(part[-1]) for name, part in printed.items()}
    rows = [
        [
            name,
            number(value),
            number(100.0 * value / design.range_nm),
            _scientific(printed_at_full[name]),
        ]
        for name, value in at_full.items()
    ]
    effect = coaxiality_effect_nm(design)
    share = 100.0 * effect / design.range_nm
    blocks: Blocks = [
        Diagram(
            [consistent, as_printed],
            "The three parts of the additional torque and their sum, odd in the torque. Below, the "
            "equations as printed, for clockwise torque: they multiply by the strain coefficient "
            "where they must divide, so their sum isn't a torque of this chain.",
        ),
        Table(
            ("part at full scale", "consistent, N·m", "% FS", "as printed, N·m"),
            rows,
            Message("{name}, {range_nm:g} N·m.", design.name, design.range_nm),
        ),
        _sensitivity_table(design),
        Facts(
            (
                (
                    "Coaxiality limit [J]",
                    Message(
                        "0.03 mm changes the torque at full scale by {effect} N·m ({share} % FS)",
                        number(effect),
                        number(share),
                    ),
                ),
            )
        ),
    ]
    ours = Message(
        "at {range_nm:g} N·m: {sum} N·m ({share} % FS), a coaxiality error of 0.03 mm alone "
        "{effect} N·m",
        design.range_nm,
        number(at_full["sum"]),
        number(100.0 * at_full["sum"] / design.range_nm),
        number(effect),
    )
    return Answer(ours, "shown", "Quadratic in the torque; dimensions are an example"), blocks


def _sensitivity_table(design: Design) -> Table:
    rows = []
    for name, found in sensitivities(design.chain, design.range_nm).items():
        if name == "torque_nm":
            continue
        value = float(getattr(design.chain, name))
        slope = float(found.derivative)
        percent = slope * 0.01 * value
        rows.append(
            (abs(percent), [_WORDS[name], _scientific(value, 4), _scientific(slope),
                            found.unit, number(percent) if percent else "0"])
        )  # fmt: skip
    rows.sort(key=lambda row: -row[0])
    return Table(
        ("parameter", "value (SI)", "sensitivity", "unit", "per 1 %, N·m"),
        [row for _, row in rows],
        "Sensitivity of the additional torque at full scale; the largest per 1 % of the "
        "parameter's value first.",
    )


def sign_blocks() -> tuple[Answer, Blocks]:
    """Compare the compensation of two chains whose additional torques have opposite signs."""
    models = (
        Contender("polynomial", "polynomial, degree 2", {"degree": 2}),
        Contender(
            "published-network",
            "BP, additional torque",
            {"start": "small-uniform", "epochs": 20_000},
        ),
        Contender("hybrid", "physics + Gaussian process"),
    )
    found = {
        sign: errors_of(
            replace(chain, scale_nm=sign * abs(chain.scale_nm)), "200 up and down", models
        )
        for sign in (1, -1)
        for chain in (studied_chain("rippled", 1),)
    }
    rows, ratios = [], []
    for more, less in zip(found[1], found[-1], strict=True):
        if not more.title.startswith("BP"):
            ratios.append(max(more.worst_nm, less.worst_nm) / min(more.worst_nm, less.worst_nm))
        rows.append([more.title, number(more.worst_nm), number(less.worst_nm)])
    table = Table(
        (
            "model",
            "reducer gets more than is read: worst, N·m",
            "reducer gets less: worst, N·m",
        ),
        rows,
        "One synthetic chain of 2000 N·m with a step at reversal, a loop, ripple and "
        "local errors, and the same chain with the other sign: 200 points up and down, "
        "500 fresh readings. Additional torque is standard - reading here, so that its "
        "sign follows from the calibration and is never assumed. The random start "
        "weights of BP aren't symmetric: with the other sign its training proceeds "
        "differently.",
    )
    answer = Answer(
        Message(
            "worst errors of both signs differ by a factor of at most {factor}", number(max(ratios))
        ),
        "met" if max(ratios) < 1.5 else "not met",
        "The sign follows from the calibration, not from a formula",
    )
    return answer, [table]


def section_blocks() -> tuple[Answer, Blocks]:
    """Return table and figure of a rectangle's twist relative to a circle of equal area."""
    ratios = np.array([1.0, 1.5, 2.0, 3.0, 5.0, 10.0, 20.0])
    factors, twists = rectangle_torsion_factor(ratios), equal_area_twist_ratio(ratios)
    rows = [
        [f"{ratio:g}", number(float(factor), 4), number(float(twist), 4)]
        for ratio, factor, twist in zip(ratios, factors, twists, strict=True)
    ]
    grid = np.geomspace(1.0, 100.0, 200)
    curve = Curve("closed form", grid, equal_area_twist_ratio(grid))
    endless = Curve("a/b → ∞: 3 (a/b) / (2π)", grid, 3.0 * grid / tau, raw=True)
    ratio_panel = Panel(
        [curve, endless], "a/b", "θ of the rectangle / θ of the circle", logarithmic="xy"
    )
    gain = float(hollow_circle_gain(0.8))
    blocks: Blocks = [
        Table(
            ("a/b", "β", "θ ratio"),
            rows,
            "Twist per length θ of a rectangle by that of a circle of the same area, by "
            "Saint-Venant's series. The rectangle's torsion constant is β a b³.",
        ),
        Diagram(
            [ratio_panel], "The ratio over a/b; above 1 everywhere, and it grows without bound."
        ),
        Facts(
            (
                (
                    "Hollow circle, d/D = 0.8",
                    Message(
                        "{gain} times as stiff as a solid one of the same area", number(gain, 4)
                    ),
                ),
            )
        ),
    ]
    return (
        Answer(
            Message(
                "{square} (a/b = 1) to {flat} (a/b = 20)",
                *(number(float(equal_area_twist_ratio(each)), 4) for each in (1.0, 20.0)),
            ),
            "met",
            "The circle is stiffer for every a/b",
        ),
        blocks,
    )


def support_blocks(
    torque_nm: float = 2000.0, design: SupportDesign | None = None, size_m: float = 0.06
) -> tuple[Answer, Blocks]:
    """Return figures and stiffnesses of both supports from three-dimensional finite elements."""
    found: SupportComparison = compare_supports(torque_nm, design, size_m=size_m)
    used, length = found.design, found.design.height_m
    shorter, longer = sorted((used.column_m, used.thickness_m))
    column = float(rectangle_torsion_constant(longer, shorter))
    ring = float(polar_moment(used.cylinder_m, used.bore_m))
    modulus = used.shear_modulus_pa
    rows = []
    for name, body, constant in (
        ("cantilever, about the vertical axis", found.cantilever, column),
        ("cantilever, about the horizontal shaft", found.horizontal, None),
        ("hollow cylinder, about its axis", found.cylinder, ring),
    ):
        alone = "–" if constant is None else _scientific(modulus * constant / length, 4)
        rows.append(
            [
                name,
                number(1e3 * body.volume_m3, 4),
                _scientific(body.stiffness_nm_rad, 4),
                number(1e6 * body.rotation_rad, 4),
                alone,
            ]
        )
    blocks: Blocks = [
        Figure(
            bodies_figure(
                [
                    ("A", found.cantilever),
                    ("B", found.horizontal),
                    ("C", found.cylinder),
                ]
            ),
            Message(
                "Supports under {torque:g} N·m, feet clamped: cantilever about the vertical axis "
                "(A) and about the horizontal shaft (B), hollow cylinder (C). Colours: "
                "displacement, which is enlarged alike. A horizontal bench's torque acts about its "
                "shaft, along the arm: it bends the column.",
                torque_nm,
            ),
        ),
        Table(
            (
                "support",
                "volume, dm³",
                "stiffness, N·m/rad",
                "rotation, µrad",
                "section alone, N·m/rad",
            ),
            rows,
            "Linear elasticity with quadratic tetrahedra. Last column: Saint-Venant torsion of "
            "the column's and of the cylinder's section over the same height; the arm and its "
            "bending make the cantilever softer than its column.",
        ),
        Facts(
            (
                ("Height", f"{used.height_m:g} m"),
                (
                    "Cantilever",
                    Message(
                        "column {column:g} m × {thickness:g} m, arm {arm:g} m × {height:g} m",
                        used.column_m,
                        used.thickness_m,
                        used.arm_m,
                        used.arm_height_m,
                    ),
                ),
                (
                    "Cylinder",
                    Message(
                        "D {outer:g} m, d {inner:.3f} m, same mass", used.cylinder_m, used.bore_m
                    ),
                ),
            )
        ),
    ]
    answer = Answer(
        Message(
            "cylinder {ratio} times as stiff with the same mass under the same load, {horizontal} "
            "times as the cantilever about its horizontal shaft",
            number(found.ratio),
            number(found.horizontal_ratio),
        ),
        "met",
        "Dimensions are an example; the papers' aren't published",
    )
    return answer, blocks
