"""The bench: its description, instruments, acquisition, devices, interlocks and supervisor.

Instruments sit behind narrow roles (`drivers`); acquisition turns their edges into torque in a
thread of its own, and the supervisor judges every block below any procedure.
"""

from torquebench.bench.description import BenchDescription, default_bench, load_bench, parse_bench

__all__ = ["BenchDescription", "default_bench", "load_bench", "parse_bench"]
