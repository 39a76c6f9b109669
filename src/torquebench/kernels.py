"""Decorators for functions that Numba compiles; decision 188 explains why there are two."""

import ctypes
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

from numba import njit
from numba.core.registry import CPUDispatcher

kernel: Any = partial(njit, cache=True, no_cfunc_wrapper=True)
"""Decorator for a function that Python calls: compiled once after an installation, then cached in a
file."""


class _Inner(CPUDispatcher):
    """A compiled function without an interface for Python, which interprets it instead."""

    def __call__(self, *arguments: Any) -> Any:
        return self.py_func(*arguments)


def inner(function: Any = None, **options: Any) -> Any:
    """Mark a function that only kernels call; `options` are those of Numba's `njit`.

    It is compiled into the kernels, without an interface for Python and without a cache file, whose
    creation takes longer than that of the function. If Python calls it, as in a test, it is
    interpreted.
    """
    if function is None:
        return partial(inner, **options)
    made = njit(function, no_cpython_wrapper=True, no_cfunc_wrapper=True, **options)
    made.__class__ = _Inner
    return made


_DONT_NEED = 4  # madvise's MADV_DONTNEED


def release_compiler() -> None:
    """Give the pages of LLVM's code back to the system, on Linux: 50 MB of a process.

    Kernels that are loaded don't need them; for another one the system reads them from the file.
    """
    with suppress(OSError, AttributeError):
        advise = ctypes.CDLL(None).madvise
        for line in Path("/proc/self/maps").read_text().splitlines():
            span, access, *_ = line.split()
            if access == "r-xp" and "llvmlite" in line:
                begin, end = (int(address, 16) for address in span.split("-"))
                advise(ctypes.c_void_p(begin), ctypes.c_size_t(end - begin), _DONT_NEED)
