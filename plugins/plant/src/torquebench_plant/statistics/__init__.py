"""Statistics of production and of many benches: pure, values in and values out."""

from torquebench_plant.statistics.capability import Capability, capability, limits_in_words
from torquebench_plant.statistics.ewma import EwmaChart, ewma_chart
from torquebench_plant.statistics.outlying import GroupDifference, outlying_groups, outlying_values
from torquebench_plant.statistics.travelling import (
    BenchResult,
    ComparedBench,
    TravellingComparison,
    compare_benches,
)

__all__ = [
    "BenchResult",
    "Capability",
    "ComparedBench",
    "EwmaChart",
    "GroupDifference",
    "TravellingComparison",
    "capability",
    "compare_benches",
    "ewma_chart",
    "limits_in_words",
    "outlying_groups",
    "outlying_values",
]
