import io
import zipfile

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from torquebench.errors import InputError
from torquebench.signals.digital import DigitalInput, edges_of_bits, edges_of_bytes
from torquebench.signals.sigrok import parse_sigrok


def plain_edges(level):
    """Rising and falling edges by the textbook."""
    change = np.diff(level.astype(np.int8))
    return np.flatnonzero(change == 1) + 1, np.flatnonzero(change == -1) + 1


@st.composite
def levels(draw, multiple=1):
    runs = draw(st.lists(st.integers(1, 200), min_size=1, max_size=40))
    first = draw(st.booleans())
    level = np.repeat((np.arange(len(runs)) + first) % 2, runs).astype(np.uint8)
    return level[: level.size // multiple * multiple]


@given(level=levels(), channel=st.integers(0, 7), cut=st.integers(0, 3000))
def test_bytes_however_cut_give_the_edges_of_the_channel(level, channel, cut):
    noise = np.uint8(0xFF & ~(1 << channel))
    samples = (level << channel) | (noise & 0x5A)
    rising, falling = plain_edges(level)
    stream = DigitalInput(1e6)
    blocks = [stream.push_bytes(samples[:cut], channel), stream.push_bytes(samples[cut:], channel)]
    assert np.concatenate([block.ticks for block in blocks]).tolist() == rising.tolist()
    assert np.concatenate([block.falling_ticks for block in blocks]).tolist() == falling.tolist()
    assert (blocks[0].stop_tick, blocks[1].stop_tick) == (blocks[1].start_tick, level.size)


@pytest.mark.parametrize(
    ("order", "packing"), [("lowest first", "little"), ("highest first", "big")]
)
@given(level=levels(multiple=8), cut=st.integers(0, 400))
def test_bits_however_cut_give_the_same_edges(order, packing, level, cut):
    packed = np.packbits(level, bitorder=packing)
    rising, falling = plain_edges(level)
    stream = DigitalInput(1e6, order)
    blocks = [stream.push_bits(packed[:cut]), stream.push_bits(packed[cut:])]
    assert np.concatenate([block.ticks for block in blocks]).tolist() == rising.tolist()
    assert np.concatenate([block.falling_ticks for block in blocks]).tolist() == falling.tolist()


@pytest.mark.parametrize(
    ("order", "packing"), [("lowest first", "little"), ("highest first", "big")]
)
def test_noise_that_changes_at_every_second_sample(order, packing):
    packed = np.random.default_rng(1).integers(0, 256, 100_000, dtype=np.uint8)
    rising, falling = plain_edges(np.unpackbits(packed, bitorder=packing))
    block = edges_of_bits(packed, 1e6, order)
    assert np.array_equal(block.ticks, rising)
    assert np.array_equal(block.falling_ticks, falling)
    alternating = edges_of_bits(np.full(50_001, 0x55, dtype=np.uint8), 1e6, order)
    assert len(alternating) + alternating.falling_ticks.size == 8 * 50_001 - 1


def test_bytes_and_bytes_objects_are_the_same():
    assert edges_of_bytes(b"\x00\x01\x00\x01", 1e6).ticks.tolist() == [1, 3]
    assert edges_of_bytes(np.array([False, True]), 1e6).ticks.tolist() == [1]


def test_unaligned_memory_is_read_right():
    packed = np.tile(np.array([0, 255], dtype=np.uint8), 41)
    view = np.concatenate(([7], packed)).astype(np.uint8)[1:]
    assert np.array_equal(edges_of_bits(view, 1e6).ticks, edges_of_bits(packed, 1e6).ticks)


@pytest.mark.parametrize(
    ("act", "message"),
    [
        (lambda: DigitalInput(0.0), "sample rate"),
        (lambda: DigitalInput(1e6, "sideways"), "bit order"),
        (lambda: edges_of_bytes([1, 0], 1e6, channel=8), "channel 8"),
        (lambda: edges_of_bytes([[1, 0]], 1e6), "dimensions"),
        (lambda: edges_of_bytes([1.5, 0.2], 1e6), "float64"),
        (lambda: edges_of_bits([1, 300], 1e6), "bytes, 0 to 255"),
    ],
)
def test_what_is_no_row_of_samples_is_refused(act, message):
    with pytest.raises(InputError, match=message):
        act()


def session(metadata, members):
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        archive.writestr("version", "2")
        archive.writestr("metadata", metadata)
        for name, data in members.items():
            archive.writestr(name, data)
    return content.getvalue()


METADATA = """[global]
sigrok version=0.5.0
[device 1]
capturefile=logic-1
total probes=9
samplerate=2 MHz
probe1=STEP
probe9=DIR
unitsize=2
"""


class TestSigrok:
    def test_parts_are_joined_in_the_order_of_their_numbers(self):
        parts = {f"logic-1-{k}": bytes([k % 2, 0, 0, k % 2]) for k in range(1, 12)}
        recording = parse_sigrok(session(METADATA, parts))
        assert recording.sample_rate_hz == 2e6
        assert (recording.channels[0], recording.channels[8]) == ("STEP", "DIR")
        assert recording.samples[:, 0].tolist() == [1, 0, 0, 0] * 5 + [1, 0]
        assert recording.edges("STEP").ticks.tolist() == [4, 8, 12, 16, 20]
        assert recording.edges(8).ticks.tolist() == [1, 5, 9, 13, 17, 21]

    @pytest.mark.parametrize(
        ("content", "message"),
        [
            (b"no zip", "no sigrok session"),
            (session("[device 2]\n", {}), "no sigrok session"),
            (session(METADATA, {}), "0 bytes"),
            (session(METADATA, {"logic-1-1": b"123"}), "whole samples of 2 bytes"),
            (session(METADATA.replace("2 MHz", "fast"), {"logic-1-1": b"12"}), "sample rate"),
        ],
    )
    def test_what_is_no_session_is_refused(self, content, message):
        with pytest.raises(InputError, match=message):
            parse_sigrok(content)

    @pytest.mark.parametrize("channel", ["RX", 16, -1])
    def test_an_unknown_channel_is_refused(self, channel):
        recording = parse_sigrok(session(METADATA, {"logic-1-1": b"1234"}))
        with pytest.raises(InputError, match="channel"):
            recording.edges(channel)
