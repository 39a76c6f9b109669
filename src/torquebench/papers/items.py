"""Statements of the two source papers, item by item; the papers' figures are quoted only here.

[J] Z. Yu, Y. Zhang, Torque Measurement of High-Precision Reducer for Industrial Robot, Journal of
Sensors, 2021. [M] Z. Yu, Y. Zhang, W. Yu, X. Liu, Measurement and Control, 2022, doi
10.1177/00202940221103308. The contents of their tables and pictures weren't available as text, so a
reproduction is the same experiment in the same form, compared with the limits in their text.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

Fulfilment = Literal["met", "not met", "partly", "shown", "not measured", "missing"]


@dataclass(frozen=True)
class Item:
    """One item of the papers.

    Attributes
    ----------
    number : int
    title : str
    theirs : str
        The papers' statement.
    command : str
        The command that reproduces this item alone.
    """

    number: int
    title: str
    theirs: str
    command: str = "torquebench papers"


@dataclass(frozen=True)
class Answer:
    """Result of this software for an item.

    Attributes
    ----------
    ours : str
    verdict : Fulfilment
    why : str
    """

    ours: str
    verdict: Fulfilment
    why: str = ""


_ITEMS = (
    Item(
        1,
        "Six sub-systems of the bench",
        "power supply, guide rail (moves the input module), input module TMMISR, tested assembly "
        "TA, output module TMMOSR, work bench",
        "torquebench doctor",
    ),
    Item(
        2,
        "Modes and mounting",
        "each side free, driven or locked; hydraulic clamp; coaxiality within 0.03 mm [J]; "
        "mounting on horizontal benches takes over an hour",
        "torquebench calibrate --mounting",
    ),
    Item(
        3,
        "Hardware",
        "T40B transducers 0-50 and 0-2000 N·m, 0.1 %; PXIe-7961; servo SMS15-42P2C; torque motor "
        "MDD310 (Modrol); acquisition 0.1 %; loading 0.1 % of range",
        "torquebench calibrate --report",
    ),
    Item(
        4,
        "Additional torque of the chain",
        "[J] eqs 1-15: bearing friction + parallel + angular misalignment, quadratic in the torque",
        "torquebench mechanics additional-torque",
    ),
    Item(
        5,
        "Sign of the additional torque",
        "[J] and [M] say that the reducer gets less than the transducer reads; the formulas can be "
        "read either way",
        "torquebench mechanics additional-torque",
    ),
    Item(
        6,
        "Rectangle against circle",
        "[M]: torsion per length of a rectangle (a, b) against a circle of equal area, "
        "a/b in [1, ∞)",
        "torquebench mechanics sections",
    ),
    Item(
        7,
        "Cantilever support against hollow cylinder",
        "[M] figs 3, 4: finite elements of both supports under the same torque",
        "torquebench mechanics supports",
    ),
    Item(
        8,
        "Calibrator",
        "takes the TA's place, two outputs, certified at 50 evenly spaced points",
        "torquebench calibrate",
    ),
    Item(
        9,
        "Loading",
        "zero without load; then 2 % of range every 500 ms from 0 to full range, clockwise and "
        "counter-clockwise; DC component of each step",
        "torquebench calibrate --rising-only",
    ),
    Item(
        10,
        "BP network",
        "1-50-1, tansig, purelin, gradient descent; input: reading; output: additional torque [J] "
        "or standard torque [M]; trained until the total error is below a set value; 50 nodes "
        "found by trials",
        "torquebench fit --model published-network",
    ),
    Item(11, "Polynomial", "polynomial for comparison", "torquebench fit --model polynomial-2"),
    Item(
        12,
        "Error curves",
        "[J] fig 10, [M] figs 11, 12: error curve of each module in both directions",
        "torquebench calibrate --report",
    ),
    Item(
        13,
        "Errors before and after",
        "[M] figs 13-15: errors before and after on fresh points: BP input, BP output, polynomial "
        "output",
        "torquebench verification --report",
    ),
    Item(
        14,
        "Ten groups",
        "standard of 0.002 %; ten groups of 50 points at the same torques, repeated [M tables 4, "
        "5]; claim: 0.1 % error and 0.1 % repeatability",
        "torquebench verification --same-points",
    ),
    Item(
        15,
        "BP against polynomial",
        "BP: below 1.8 N·m (0.09 % FS of 2000 N·m); polynomial: up to 4 N·m (0.20 %); in total "
        "0.1 %",
        "torquebench papers --whole",
    ),
    Item(
        16,
        "Calibrated alone",
        "horizontal bench, transducer calibrated alone: about 0.5 %",
        "torquebench in-place",
    ),
    Item(
        17,
        "Standard reducer",
        "known, certified no-load friction, output disconnected, 0-1200 rpm in steps (0-15 rpm at "
        "the output, i = 80), three repeats [M fig 16, table 6]",
        "torquebench standard-reducer",
    ),
    Item(
        18,
        "Interface",
        "LabVIEW: loading, acquisition, training, compensation, display, parameters, status, "
        "faults, operation",
        "torquebench panel",
    ),
    Item(19, "Static and dynamic", "“static and dynamic measurements”", "torquebench turn"),
    Item(20, "Next steps", "[J]: speed, lubrication, temperature", "torquebench fit --empty"),
    Item(
        21,
        "Purpose",
        "torsional rigidity, transmission error, backlash, lost motion, efficiency",
        "torquebench test full",
    ),
    Item(
        22,
        "Frequency acquisition",
        "T40B acquired by PXIe-7961; acquisition 0.1 %",
    ),
)
ITEMS: Mapping[int, Item] = MappingProxyType({item.number: item for item in _ITEMS})
"""All items, by number, in the papers' order."""

SUB_SYSTEMS = (
    "power supply",
    "guide rail",
    "input module",
    "tested assembly",
    "output module",
    "work bench",
)
"""The six sub-systems that the papers name."""
LOADING = "0.1 % of range"
LIMIT_PERCENT = 0.1
"""Error and repeatability stated by the papers, % FS."""
HARDWARE: Mapping[str, str] = MappingProxyType(
    {
        "transducer, input": "T40B, 0-50 N·m, 0.1 %",
        "transducer, output": "T40B, 0-2000 N·m, 0.1 %",
        "acquisition": "PXIe-7961, 0.1 %",
        "drive, input": "servo SMS15-42P2C",
        "drive, output": "torque motor MDD310 (Modrol)",
        "standard": "0.002 %",
        "guide rail": "not published",
        "power supply": "not published",
    }
)
"""Hardware that the papers name, by keys of `facts.bench_facts`."""
