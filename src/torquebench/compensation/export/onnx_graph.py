"""ONNX export: the table as elementary double-precision operations of any ONNX runtime."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from torquebench.atomic_write import atomic_write
from torquebench.compensation.export.branches import turning_nm
from torquebench.compensation.export.shared import provenance_lines
from torquebench.compensation.model_file import Provenance
from torquebench.errors import InputError

if TYPE_CHECKING:
    from torquebench.compensation.piecewise import PiecewisePolynomial
    from torquebench.compensation.table import CompensationTable

_OPERATOR_SET = 17
_FORMAT_VERSION = 8


def export_onnx(path: Path, table: CompensationTable, provenance: Provenance) -> Path:
    """Export a table as an ONNX model.

    Parameters
    ----------
    path : Path
        Where to.
    provenance : Provenance
        Origin of the model, which is also stored in the ONNX metadata.

    Raises
    ------
    InputError
        When the package onnx isn't installed.

    Notes
    -----
    Inputs: ``reading_nm`` (double, n) and ``branch`` (int64, n; -1, 0, +1). Outputs: ``torque_nm``,
    ``curve_uncertainty_nm`` where the table has it, and ``in_range`` (bool), which is false for
    readings outside the accepted range and for those that aren't a number.

    If the curve depends on the branch, 2 as the branch stands for the one that follows from the
    readings so far. Their history is the optional input ``history`` (double, 2), for which the
    output ``history_after`` of the readings before is given; ``branch_followed`` is the branch.
    """
    try:
        import onnx
        from onnx import TensorProto, helper
    except ImportError as problem:
        raise InputError(
            "the package onnx isn't installed",
            remedy='install it: pip install "torquebench[onnx]"',
        ) from problem
    graph = _Graph(helper, TensorProto)
    follows = table.curve.branch_aware
    if follows:
        graph.followed_branch(turning_nm(table))
    graph.shared(table.curve, "branch_used" if follows else "branch")
    outputs = [graph.curve(table.curve, "torque_nm")]
    if table.uncertainty_curve is not None:
        outputs.append(graph.curve(table.uncertainty_curve, "curve_uncertainty_nm"))
    values = [
        helper.make_tensor_value_info("reading_nm", TensorProto.DOUBLE, ["n"]),
        helper.make_tensor_value_info("branch", TensorProto.INT64, ["n"]),
    ]
    results = [
        *(helper.make_tensor_value_info(name, TensorProto.DOUBLE, ["n"]) for name in outputs),
        helper.make_tensor_value_info("in_range", TensorProto.BOOL, ["n"]),
    ]
    if follows:
        values.append(helper.make_tensor_value_info("history", TensorProto.DOUBLE, [2]))
        results += [
            helper.make_tensor_value_info("branch_followed", TensorProto.INT64, ["n"]),
            helper.make_tensor_value_info("history_after", TensorProto.DOUBLE, [2]),
        ]
    model = helper.make_model(
        helper.make_graph(graph.nodes, "torque_compensation", values, results, graph.constants),
        producer_name="torquebench",
        producer_version=provenance.software_version,
        doc_string="\n".join(provenance_lines(table, provenance)),
        opset_imports=[helper.make_opsetid("", _OPERATOR_SET)],
        ir_version=_FORMAT_VERSION,
    )
    record = {**asdict(provenance), "metrics": dict(provenance.metrics)}
    helper.set_model_props(
        model,
        {
            "provenance": json.dumps(record, sort_keys=True),
            "unit": "N·m",
            "bound_nm": repr(table.bound_nm),
        },
    )
    onnx.checker.check_model(model, full_check=True)
    atomic_write(path, model.SerializeToString(deterministic=True))
    return path


class _Graph:
    """Nodes and constants of the model, collected operation by operation."""

    def __init__(self, helper: Any, types: Any) -> None:
        self.helper, self.types = helper, types
        self.nodes: list[Any] = []
        self.constants: list[Any] = []

    def constant(self, name: str, value: Any) -> str:
        """Add a constant to the graph, and return its name."""
        array = np.asarray(value)
        kind = self.types.INT64 if array.dtype.kind == "i" else self.types.DOUBLE
        self.constants.append(
            self.helper.make_tensor(name, kind, array.shape, array.ravel().tolist())
        )
        return name

    def apply(self, operation: str, inputs: list[str], output: str, **attributes: Any) -> str:
        self.nodes.append(self.helper.make_node(operation, inputs, [output], **attributes))
        return output

    def followed_branch(self, turning: float) -> None:
        """Follow the readings as `followed_branches` does, and take that branch where 2 is given.

        The history is the direction, and the last extreme reading: not a number at the start.
        """
        body = _Graph(self.helper, self.types)
        unknown = body.apply("IsNaN", ["extreme"], "unknown")
        extreme = body.apply("Where", [unknown, "reading", "extreme"], "last_extreme")
        moved = body.apply("Sub", ["reading", extreme], "moved")
        along = body.apply("Mul", [moved, "direction"], "along")
        zero = body.constant("zero", 0.0)
        goes_on = body.apply("Greater", [along, zero], "goes_on")
        size = body.apply("Abs", [moved], "size")
        turns = body.apply("Greater", [size, body.constant("turning", turning)], "turns")
        changes = body.apply("Or", [goes_on, turns], "changes")
        sign = body.apply("Sign", [moved], "sign")
        body.apply("Where", [changes, sign, "direction"], "new_direction")
        body.apply("Where", [changes, "reading", extreme], "new_extreme")
        opposite = body.apply("Neg", ["new_direction"], "opposite")
        clockwise = body.apply("GreaterOrEqual", ["reading", zero], "clockwise")
        branch = body.apply("Where", [clockwise, "new_direction", opposite], "number")
        body.apply("Cast", [branch], "one_branch", to=self.types.INT64)

        def value(name: str, kind: int) -> Any:
            return self.helper.make_tensor_value_info(name, kind, [])

        double = self.types.DOUBLE
        graph = self.helper.make_graph(
            body.nodes,
            "follow_readings",
            [value(name, double) for name in ("direction", "extreme", "reading")],
            [
                value("new_direction", double),
                value("new_extreme", double),
                value("one_branch", self.types.INT64),
            ],
            body.constants,
        )
        self.constant("history", [0.0, np.nan])
        for name, place in (("direction", 0), ("extreme", 1)):
            at = self.constant(f"place_of_{name}", place)
            self.apply("Gather", ["history", at], f"{name}_before", axis=0)
        before = ["direction_before", "extreme_before", "reading_nm"]
        after = ["direction_after", "extreme_after", "branch_followed"]
        self.nodes.append(
            self.helper.make_node("Scan", before, after, body=graph, num_scan_inputs=1)
        )
        first = self.constant("first_axis", [0])
        pair = [self.apply("Unsqueeze", [name, first], f"{name}_1") for name in after[:2]]
        self.apply("Concat", pair, "history_after", axis=0)
        asked = self.apply("Equal", ["branch", self.constant("two", 2)], "branch_asked")
        self.apply("Where", [asked, "branch_followed", "branch"], "branch_used")

    def shared(self, curve: PiecewisePolynomial, branch: str) -> None:
        """Clamp the reading, record whether it was in range, and map the branch to 0, 1 or 2."""
        low, high = self.constant("low", curve.low), self.constant("high", curve.high)
        above = self.apply("GreaterOrEqual", ["reading_nm", low], "above_low")
        below = self.apply("LessOrEqual", ["reading_nm", high], "below_high")
        self.apply("And", [above, below], "in_range")
        # a comparison with NaN is false and selects the limit
        greater = self.apply("Greater", ["reading_nm", low], "greater_than_low")
        raised = self.apply("Where", [greater, "reading_nm", low], "raised")
        self.apply("Min", [raised, high], "clamped")
        sign = self.apply("Sign", [branch], "branch_sign")
        self.apply("Add", [sign, self.constant("one", 1)], "side")

    def curve(self, curve: PiecewisePolynomial, output: str) -> str:
        """Locate the interval, gather its coefficients, evaluate by Horner's scheme."""

        def named(part: str) -> str:
            return f"{output}_{part}"

        def constant(part: str, value: float) -> str:
            return self.constant(named(part), value)

        limits = constant("minus_near", -curve.near), constant("near", curve.near)
        raised = self.apply("Max", ["clamped", limits[0]], named("raised"))
        central = self.apply("Min", [raised, limits[1]], named("central"))
        far = self.apply("Mul", ["clamped", constant("scale", curve.scale)], named("far"))
        finer = self.apply("Mul", [central, constant("extra", curve.extra)], named("finer"))
        both = self.apply("Add", [far, finer], named("both"))
        location = self.apply("Add", [both, constant("zero", curve.zero)], named("location"))
        rounded = self.apply("Round", [location], named("whole"))
        fraction = self.apply("Sub", [location, rounded], named("place"))
        number = self.apply("Cast", [rounded], named("interval"), to=self.types.INT64)
        count = self.constant(named("count"), curve.intervals)
        offset = self.apply("Mul", ["side", count], named("offset"))
        row = self.apply("Add", [number, offset], named("row"))
        value = ""
        for power in range(curve.degree, -1, -1):
            column = curve.coefficients[:, :, power].ravel()
            store = self.constant(named(f"c{power}"), column)
            taken = self.apply("Gather", [store, row], named(f"taken_{power}"), axis=0)
            if not value:
                value = taken
                continue
            product = self.apply("Mul", [value, fraction], named(f"product_{power}"))
            last = power == 0 and not curve.gain
            value = self.apply("Add", [product, taken], output if last else named(f"sum_{power}"))
        if curve.gain:
            self.apply("Add", [value, "reading_nm"], output)
        return output
