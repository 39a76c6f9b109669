"""One pass over a window's edges in eight lanes of the processor's vector unit.

Left to itself, the compiler splits the short loop over a window into an unrolled part, a rest in
vectors and a rest in single edges, each with its own sums at the end, and needs a second loop
for the intervals. Here every edge is read once, in groups of eight, the last of which overlaps
the one before it. Any processor runs this: the compiler splits eight lanes where it has fewer.
"""

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

__all__ = ["LANES", "slope_and_intervals_in_lanes"]

LANES = 8
_WORD = ir.IntType(64)
_VECTOR = ir.VectorType(_WORD, LANES)
_FARTHEST = 2**62


def _word(value: int) -> Any:
    return ir.Constant(_WORD, value)


def _vector(values: list[int]) -> Any:
    return ir.Constant(_VECTOR, values)


def _in_all_lanes(builder: Any, value: Any) -> Any:
    undefined = ir.Constant(_VECTOR, ir.Undefined)
    first = builder.insert_element(undefined, value, ir.Constant(ir.IntType(32), 0))
    zeros = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
    return builder.shuffle_vector(first, undefined, zeros)


def _call(builder: Any, name: str, result: Any, *arguments: Any) -> Any:
    function_type = ir.FunctionType(result, [argument.type for argument in arguments])
    function = cgutils.get_or_insert_function(
        builder.module, function_type, f"llvm.{name}.v{LANES}i64"
    )
    return builder.call(function, arguments)


class _Sums:
    """Slope sum, shortest and longest interval, each in eight lanes."""

    def __init__(self, builder: Any, data: Any, low: Any, high: Any) -> None:
        self._builder = builder
        self._data = data
        self._low = low
        self._high = high
        # Weights 2i + 1 − n of the edges i = 0 … n − 1.
        first = builder.sub(_word(1), builder.sub(high, low))
        weights = builder.add(
            _in_all_lanes(builder, first), _vector([2 * lane for lane in range(LANES)])
        )
        self._weights = cgutils.alloca_once_value(builder, weights)
        self._slope = cgutils.alloca_once_value(builder, _vector([0] * LANES))
        self._shortest = cgutils.alloca_once_value(builder, _vector([_FARTHEST] * LANES))
        self._longest = cgutils.alloca_once_value(builder, _vector([-_FARTHEST] * LANES))

    def _load(self, index: Any) -> Any:
        builder = self._builder
        address = builder.gep(self._data, [index])
        return builder.load(builder.bitcast(address, _VECTOR.as_pointer()), align=8)

    def _update(self, place: Any, change: Callable[[Any], Any]) -> None:
        self._builder.store(change(self._builder.load(place)), place)

    def add(self, index: Any, counted: Any = None) -> None:
        """Add eight edges from an index on, but for the slope those counted already."""
        builder = self._builder
        edges = self._load(index)
        intervals = builder.sub(edges, self._load(builder.sub(index, _word(1))))
        parts = builder.mul(edges, builder.load(self._weights))
        if counted is not None:
            parts = builder.select(counted, _vector([0] * LANES), parts)
        self._update(self._slope, lambda old: builder.add(old, parts))
        self._update(self._shortest, lambda old: _call(builder, "smin", _VECTOR, old, intervals))
        self._update(self._longest, lambda old: _call(builder, "smax", _VECTOR, old, intervals))
        self.move_weights(_word(2 * LANES))

    def move_weights(self, distance: Any) -> None:
        builder = self._builder
        self._update(self._weights, lambda old: builder.add(old, _in_all_lanes(builder, distance)))

    def result(self) -> list[Any]:
        """Sum, least and greatest over the lanes."""
        builder = self._builder
        return [
            _call(builder, f"vector.reduce.{name}", _WORD, builder.load(place))
            for name, place in (
                ("add", self._slope),
                ("smin", self._shortest),
                ("smax", self._longest),
            )
        ]


@intrinsic
def slope_and_intervals_in_lanes(typing_context: Any, ticks: Any, low: Any, high: Any) -> Any:  # noqa: ARG001
    """Sum of (2i + 1 − n)·ticks[low + i] over n edges, and their shortest and longest interval.

    Intervals are those that end at the edges, so ticks[low − 1] must exist, and there must be
    eight edges or more.

    Parameters
    ----------
    ticks : int64 array, shape (m,)
        Edges.
    low, high : int64
        First edge and the one after the last; low > 0, high − low ≥ 8.

    Returns
    -------
    slope_sum, shortest, longest : int64
    """

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        view = context.make_array(signature.args[0])(context, builder, arguments[0])
        first, after = arguments[1:]
        sums = _Sums(builder, view.data, first, after)
        count = builder.sub(after, first)
        whole = builder.and_(count, _word(-LANES))
        with cgutils.for_range_slice(builder, _word(0), whole, _word(LANES), intp=_WORD) as (
            offset,
            _,
        ):
            sums.add(builder.add(first, offset))
        rest = builder.sub(count, whole)
        with builder.if_then(builder.icmp_signed("!=", rest, _word(0))):
            # The last eight edges, the first of which were counted already.
            counted = builder.sub(_word(LANES), rest)
            sums.move_weights(builder.mul(_word(-2), counted))
            lanes = _vector(list(range(LANES)))
            again = builder.icmp_signed("<", lanes, _in_all_lanes(builder, counted))
            sums.add(builder.sub(after, _word(LANES)), again)
        return context.make_tuple(builder, signature.return_type, sums.result())

    return types.UniTuple(types.int64, 3)(ticks, types.int64, types.int64), generate
