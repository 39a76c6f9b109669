"""Piecewise polynomials on a uniform grid at the speed of memory.

Eight readings go through one block of vector instructions: clamp, locate the interval, fetch its
coefficients, evaluate. Numba's own loops stay scalar here, because its vectoriser can't rule out
that the output array overlaps the table, and are about 1.6 times slower; so the block is written
with LLVM's generic vector operations, which exist on every processor. Two coefficients share a
64-bit word (`pack_words`), which halves the fetches and keeps the table in the first-level cache;
arithmetic is double precision throughout.
"""

import itertools
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from os import cpu_count
from typing import Any

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import make_array
from numpy.typing import NDArray

__all__ = ["Grid", "evaluate", "pack_words", "unpack_words"]

Grid = tuple[float, float, float, float, float, float, float]
"""Numbers that `evaluate` locates an interval with."""

_LANES = 8
_THREAD_MINIMUM = 1 << 22
"""Readings below which a second thread costs more than it gains."""

# Adding 1.5 · 2**52 rounds a small number, a little below zero too, and leaves the whole number in
# the low bits of the double.
_WHOLE_NUMBER_IN_LOW_BITS = 1.5 * 2.0**52

_LANE = ir.IntType(32)
_WORD = ir.IntType(64)
_DOUBLES = ir.VectorType(ir.DoubleType(), _LANES)
_FLOATS = ir.VectorType(ir.FloatType(), _LANES)
_WORDS = ir.VectorType(_WORD, _LANES)
_LANES32 = ir.VectorType(_LANE, _LANES)


class _Emitter:
    """Vector operations on eight lanes, emitted through an LLVM builder."""

    def __init__(self, builder: Any) -> None:
        self.builder = builder

    def splat(self, scalar: Any) -> Any:
        vector = ir.VectorType(scalar.type, _LANES)
        undefined = ir.Constant(vector, ir.Undefined)
        first = self.builder.insert_element(undefined, scalar, ir.Constant(_LANE, 0))
        return self.builder.shuffle_vector(first, undefined, ir.Constant(_LANES32, [0] * _LANES))

    def call(self, name: str, *arguments: Any) -> Any:
        function = cgutils.get_or_insert_function(
            self.builder.module,
            ir.FunctionType(_DOUBLES, [_DOUBLES] * len(arguments)),
            f"llvm.{name}.v{_LANES}f64",
        )
        return self.builder.call(function, arguments)

    def clamp(self, value: Any, low: Any, high: Any) -> Any:
        # NaN compares false and becomes `low`, so that the index is always inside the table
        raised = self.builder.select(self.builder.fcmp_ordered(">", value, low), value, low)
        return self.builder.select(self.builder.fcmp_ordered("<", raised, high), raised, high)

    def load(self, array: Any, index: Any, vector: Any, align: int) -> Any:
        pointer = self.builder.bitcast(self.builder.gep(array.data, [index]), vector.as_pointer())
        return self.builder.load(pointer, align=align)

    def fetch(self, words: Any, position: Any) -> Any:
        """Fetch one 64-bit word a lane; scalar loads beat gather instructions."""
        builder = self.builder
        # two positions leave the vector registers at a time
        pairs = builder.bitcast(
            builder.trunc(position, _LANES32), ir.VectorType(_WORD, _LANES // 2)
        )
        result = ir.Constant(_WORDS, ir.Undefined)
        for lane in range(_LANES):
            pair = builder.extract_element(pairs, ir.Constant(_LANE, lane // 2))
            if lane % 2:
                index = builder.lshr(pair, ir.Constant(_WORD, 32))
            else:
                index = builder.and_(pair, ir.Constant(_WORD, 0xFFFFFFFF))
            word = builder.load(builder.gep(words, [index], inbounds=True))
            result = builder.insert_element(result, word, ir.Constant(_LANE, lane))
        return result

    def unpack(self, words: Any) -> tuple[Any, Any]:
        """Take each word apart as `unpack_words` does."""
        builder = self.builder
        low = builder.bitcast(builder.trunc(words, _LANES32), _FLOATS)
        return builder.fpext(low, _DOUBLES), builder.bitcast(words, _DOUBLES)

    def count(self, flags: Any) -> Any:
        bits = ir.IntType(_LANES)
        population = cgutils.get_or_insert_function(
            self.builder.module, ir.FunctionType(bits, [bits]), f"llvm.ctpop.i{_LANES}"
        )
        mask = self.builder.bitcast(flags, bits)
        return self.builder.zext(self.builder.call(population, [mask]), _WORD)


def _block_code(words_per_interval: int, with_branch: bool) -> Callable[..., Any]:
    """Make the code generator of one block of eight readings."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        reading, branch, out, table = (
            make_array(kind)(context, builder, value=value)
            for kind, value in zip(signature.args[:4], arguments[:4], strict=True)
        )
        at, stride, grid = arguments[4:7]
        emit = _Emitter(builder)
        scale, zero, extra, near, low, high, gain = (
            emit.splat(builder.extract_value(grid, number)) for number in range(7)
        )
        value = emit.load(reading, at, _DOUBLES, 8)
        clamped = emit.clamp(value, low, high)
        central = emit.clamp(clamped, builder.fneg(near), near)
        location = emit.call("fma", clamped, scale, emit.call("fma", central, extra, zero))
        bias = ir.Constant(_DOUBLES, [_WHOLE_NUMBER_IN_LOW_BITS] * _LANES)
        shifted = builder.fadd(location, bias)
        fraction = builder.fsub(location, builder.fsub(shifted, bias))
        position = builder.bitcast(shifted, _WORDS)
        if words_per_interval == 2:
            position = builder.shl(position, ir.Constant(_WORDS, [1] * _LANES))
        if with_branch:
            signs = emit.load(branch, at, ir.VectorType(ir.IntType(8), _LANES), 1)
            side = builder.add(builder.sext(signs, _WORDS), ir.Constant(_WORDS, [1] * _LANES))
            position = builder.add(position, builder.mul(side, emit.splat(stride)))
        words = builder.bitcast(table.data, _WORD.as_pointer())
        constant, slope = emit.unpack(emit.fetch(words, position))
        if words_per_interval == 2:
            following = builder.add(position, ir.Constant(_WORDS, [1] * _LANES))
            square, cube = emit.unpack(emit.fetch(words, following))
            slope = emit.call("fma", emit.call("fma", cube, fraction, square), fraction, slope)
        # not `gain · value`: an infinite or missing reading times 0 would not be 0
        none = ir.Constant(_DOUBLES, [0.0] * _LANES)
        base = builder.select(builder.fcmp_unordered("!=", gain, none), value, none)
        result = builder.fadd(base, emit.call("fma", slope, fraction, constant))
        target = builder.bitcast(builder.gep(out.data, [at]), _DOUBLES.as_pointer())
        builder.store(result, target, align=8)
        return emit.count(builder.fcmp_unordered("!=", clamped, value))

    return generate


def _block_signature(reading: Any, branch: Any, out: Any, table: Any, grid: Any) -> Any:
    return types.int64(reading, branch, out, table, types.int64, types.int64, grid)


# Each block is called with: arrays of readings, branches (int8) and results, the table as 64-bit
# words, position of the first of the eight readings, words between two branches' tables, and the
# grid as in `evaluate`.


@intrinsic
def _linear_block(context, reading, branch, out, table, at, stride, grid):  # type: ignore[no-untyped-def] # Numba infers # noqa: ARG001
    return _block_signature(reading, branch, out, table, grid), _block_code(1, False)


@intrinsic
def _linear_branch_block(context, reading, branch, out, table, at, stride, grid):  # type: ignore[no-untyped-def] # Numba infers # noqa: ARG001
    return _block_signature(reading, branch, out, table, grid), _block_code(1, True)


@intrinsic
def _cubic_block(context, reading, branch, out, table, at, stride, grid):  # type: ignore[no-untyped-def] # Numba infers # noqa: ARG001
    return _block_signature(reading, branch, out, table, grid), _block_code(2, False)


@intrinsic
def _cubic_branch_block(context, reading, branch, out, table, at, stride, grid):  # type: ignore[no-untyped-def] # Numba infers # noqa: ARG001
    return _block_signature(reading, branch, out, table, grid), _block_code(2, True)


@njit(cache=True, nogil=True)
def _linear(reading, branch, out, table, stride, grid):  # type: ignore[no-untyped-def] # Numba infers
    outside = 0
    for at in range(0, reading.size - 7, 8):
        outside += _linear_block(reading, branch, out, table, at, stride, grid)
    return outside


@njit(cache=True, nogil=True)
def _linear_branch(reading, branch, out, table, stride, grid):  # type: ignore[no-untyped-def] # Numba infers
    outside = 0
    for at in range(0, reading.size - 7, 8):
        outside += _linear_branch_block(reading, branch, out, table, at, stride, grid)
    return outside


@njit(cache=True, nogil=True)
def _cubic(reading, branch, out, table, stride, grid):  # type: ignore[no-untyped-def] # Numba infers
    outside = 0
    for at in range(0, reading.size - 7, 8):
        outside += _cubic_block(reading, branch, out, table, at, stride, grid)
    return outside


@njit(cache=True, nogil=True)
def _cubic_branch(reading, branch, out, table, stride, grid):  # type: ignore[no-untyped-def] # Numba infers
    outside = 0
    for at in range(0, reading.size - 7, 8):
        outside += _cubic_branch_block(reading, branch, out, table, at, stride, grid)
    return outside


def pack_words(coefficients: NDArray[np.float64]) -> NDArray[np.uint64]:
    """Pack coefficients two to a word.

    The first of a pair becomes a single-precision number in the word's low half. The word as a
    whole, read as a double, is the second: the low half is far below what matters of it.

    Parameters
    ----------
    coefficients : float64 array of shape (..., 2 k)

    Returns
    -------
    words : uint64 array of shape (..., k)

    Examples
    --------
    >>> unpack_words(pack_words(np.array([0.5, 0.1]))).round(6).tolist()
    [0.5, 0.1]
    """
    first = np.ascontiguousarray(coefficients[..., 0::2], dtype=np.float32)
    second = np.ascontiguousarray(coefficients[..., 1::2], dtype=np.float64)
    low = first.view(np.uint32).astype(np.uint64)
    bits = second.view(np.uint64)
    sign, size = bits & np.uint64(1 << 63), bits & np.uint64((1 << 63) - 1)
    # the size whose low half is `low` and that is nearest; next to nothing becomes that
    nearest = (np.maximum(size, low) - low + np.uint64(1 << 31)) >> np.uint64(32)
    return np.asarray(sign | (nearest << np.uint64(32)) | low)


def unpack_words(words: NDArray[np.uint64]) -> NDArray[np.float64]:
    """Return the coefficients that words hold, exactly as `evaluate` uses them.

    Parameters
    ----------
    words : uint64 array of shape (..., k)

    Returns
    -------
    coefficients : float64 array of shape (..., 2 k)
    """
    low = (words & np.uint64(0xFFFFFFFF)).astype(np.uint32).view(np.float32)
    pairs = np.stack([low.astype(np.float64), words.view(np.float64)], axis=-1)
    return pairs.reshape(*words.shape[:-1], 2 * words.shape[-1])


def evaluate(
    reading: NDArray[np.float64],
    branch: NDArray[np.int8] | None,
    out: NDArray[np.float64],
    words: NDArray[np.uint64],
    grid: Grid,
    workers: int | None = None,
) -> int:
    """Evaluate a piecewise polynomial for many readings.

    A reading x lies at ``scale · x + extra · clamp(x, −near, near) + zero`` on a scale where
    interval k reaches from k − ½ to k + ½: near zero, where the torque turns round, intervals are
    narrower. With f the distance from the middle of the interval, the result is
    ``gain · x + c₀ + c₁ f (+ c₂ f² + c₃ f³)``, gain being 0 or 1.

    Parameters
    ----------
    reading : float64 array of shape (n,), C-contiguous
        Readings in N·m. Beyond the limits the polynomial is taken at the limit.
    branch : int8 array of shape (n,), or None
        -1, 0 or +1; None takes 0 for all.
    out : float64 array of shape (n,), C-contiguous
        Filled with the results; may be `reading` itself.
    words : uint64 array of shape (3, intervals, 1 or 2), C-contiguous
        c₀, c₁ (, c₂, c₃) for the branches -1, 0 and +1, packed by `pack_words`.
    grid : tuple of 7 floats
        scale in 1/(N·m), zero, extra in 1/(N·m), near in N·m, lower and upper limit of the reading
        in N·m, gain.
    workers : int, optional
        Threads; by default as many as processors, and one for fewer than four million readings.

    Returns
    -------
    outside : int
        Number of readings outside the limits, or not a number.

    Examples
    --------
    >>> table = np.zeros((3, 4, 2))
    >>> table[1, :, 0] = [1.0, 2.0, 3.0, 4.0]
    >>> out = np.empty(3)
    >>> grid = (1.0, 1.0, 0.0, 0.0, -1.0, 2.0, 1.0)
    >>> evaluate(np.array([-1.0, 0.6, 9.0]), None, out, pack_words(table), grid)
    1
    >>> np.allclose(out, [0.0, 3.6, 13.0])
    True
    """
    linear, stride = words.shape[2] == 1, words.shape[1] * words.shape[2]
    table = words.reshape(-1)
    if branch is None:
        table, branch = table[stride : 2 * stride], np.empty(0, dtype=np.int8)
        kernel = _linear if linear else _cubic
    else:
        kernel = _linear_branch if linear else _cubic_branch
    whole = reading.size - reading.size % _LANES
    if workers is None:
        workers = (cpu_count() or 1) if reading.size >= _THREAD_MINIMUM else 1

    def run(part: slice) -> int:
        signs = branch if branch.size == 0 else branch[part]
        return int(kernel(reading[part], signs, out[part], table, stride, grid))

    if workers > 1:
        edges = [whole // _LANES * k // workers * _LANES for k in range(workers + 1)]
        parts = [slice(start, stop) for start, stop in itertools.pairwise(edges)]
        with ThreadPoolExecutor(workers) as pool:
            outside = sum(pool.map(run, parts))
    else:
        outside = run(slice(0, whole))
    if whole < reading.size:
        outside += _tail(kernel, reading[whole:], branch[whole:], out[whole:], table, stride, grid)
    return outside


def _tail(
    kernel: Callable[..., int],
    reading: NDArray[np.float64],
    branch: NDArray[np.int8],
    out: NDArray[np.float64],
    table: NDArray[np.uint64],
    stride: int,
    grid: Grid,
) -> int:
    """Evaluate the last few readings, filled up to a block of eight."""
    padded = np.full(_LANES, grid[4])
    padded[: reading.size] = reading
    signs = np.zeros(_LANES if branch.size else 0, dtype=np.int8)
    signs[: branch.size] = branch
    outside = int(kernel(padded, signs, padded, table, stride, grid))
    out[:] = padded[: reading.size]
    return outside
