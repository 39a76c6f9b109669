import threading

import pytest

from torquebench.bench.blocks import Block
from torquebench.errors import RecordError
from torquebench.station.journal import QueuedJournal


def block(index: int) -> Block:
    return Block(float(index), index + 1.0)


class Slow:
    """Keeps indices, waits for permission before each, fails from one on."""

    def __init__(self, fails_at: int = 1_000_000) -> None:
        self.kept: list[int] = []
        self.allowed = threading.Semaphore(0)
        self.fails_at = fails_at

    def write(self, block: Block) -> None:
        self.allowed.acquire()
        index = int(block.start_s)
        if index >= self.fails_at:
            raise OSError(28, "No space left on device")
        self.kept.append(index)


def test_a_slow_disk_gets_every_block_in_order_and_the_writer_waits() -> None:
    slow = Slow()
    journal = QueuedJournal(slow, maximum=3)
    written: list[int] = []

    def write() -> None:
        for index in range(20):
            journal.write(block(index))
            written.append(index)

    writer = threading.Thread(target=write)
    writer.start()
    writer.join(0.3)
    assert writer.is_alive()  # one block with the disk, three waiting, one at the door
    assert len(written) <= 4
    slow.allowed.release(20)
    writer.join()
    journal.close()
    journal.close()
    assert slow.kept == list(range(20))


def test_a_failure_reaches_whoever_writes_next_even_while_waiting() -> None:
    slow = Slow(fails_at=2)
    journal = QueuedJournal(slow, maximum=2)
    slow.allowed.release(3)

    def write_on() -> None:
        for index in range(1000):
            journal.write(block(index))

    with pytest.raises(RecordError, match=r"weren't recorded.*No space left") as raised:
        write_on()
    assert isinstance(raised.value.__cause__, OSError)
    with pytest.raises(RecordError, match="No space left"):
        journal.close()
    assert slow.kept == [0, 1]


def test_a_failure_at_the_very_end_is_raised_by_closing() -> None:
    slow = Slow(fails_at=0)
    journal = QueuedJournal(slow)
    journal.write(block(0))
    slow.allowed.release()
    with pytest.raises(RecordError, match="every block kept"):
        journal.close()
