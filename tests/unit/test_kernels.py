"""Kernels, and the compiler that made them."""

import subprocess
import sys

RELEASED = """
from pathlib import Path
from numba import njit
from torquebench.kernels import release_compiler

def resident_kb():
    sizes, name = [0], ""
    for line in Path("/proc/self/smaps").read_text().splitlines():
        first = line.split()[0]
        if not first.endswith(":"):
            name = line
        elif first == "Rss:" and "llvmlite" in name and " r-xp " in name:
            sizes.append(int(line.split()[1]))
    return sum(sizes)

double = njit(lambda number: 2 * number)
print(double(4), end=" ")
before = resident_kb()
release_compiler()
print(resident_kb() < 0.2 * before, end=" ")
print(double(5), njit(lambda number: 3 * number)(5))
"""


def test_a_released_compiler_compiles_again() -> None:
    run = subprocess.run([sys.executable, "-c", RELEASED], capture_output=True, text=True)
    assert run.stdout == "8 True 10 15\n", run.stderr
