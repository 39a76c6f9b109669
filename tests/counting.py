"""Count blocks of edges in one call."""

from collections.abc import Sequence
from typing import Any

from torquebench.signals import EdgeBlock, FrequencyCounter, Record
from torquebench.signals.counters import CounterMethod


def counted(
    blocks: EdgeBlock | Sequence[EdgeBlock],
    window_s: float,
    method: CounterMethod = "regression",
    **options: Any,
) -> Record:
    """Return the windows that a counter makes of one block, or of several that go on."""
    stream = [blocks] if isinstance(blocks, EdgeBlock) else list(blocks)
    counter = FrequencyCounter(method, window_s, stream[0].timebase_hz, **options)
    return Record.join([counter.push(block) for block in stream])
