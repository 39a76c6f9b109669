from .roles import SIDES as SIDES, Side as Side
from .description import (
    BenchDescription as BenchDescription,
    default_bench as default_bench,
    load_bench as load_bench,
    parse_bench as parse_bench,
)
