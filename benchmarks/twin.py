"""Speed of the twin, and the raw error of its benches over seeds: ``python -m benchmarks.twin``."""

import time

import numpy as np

from torquebench.twin import CHANNELS, SIDES, BenchTwin, Channel, Mounting, Preset, TwinParameters

__all__ = ["raw_errors", "speed"]


def speed(mounting: Mounting, channels: tuple[Channel, ...], *, block_s: float = 0.05) -> float:
    """Bench time by processor time of this process, over 20 s of bench time."""
    twin = BenchTwin(TwinParameters.draw("nominal", 1), 1, active_channels=channels)
    twin.mount(mounting)
    twin.set_clamped(True)
    for side in SIDES:
        twin.set_mode(side, "driven")
        twin.enable(side, True)
    twin.command_speed("input", 60.0)
    twin.advance(0.1)
    blocks = round(20.0 / block_s)
    start = time.process_time()
    for _ in range(blocks):
        twin.advance(block_s)
    return blocks * block_s / (time.process_time() - start)


def raw_errors(preset: Preset, seeds: int) -> dict[str, list[float]]:
    """Worst raw error in % FS of both sides, both directions, up and down, for each seed."""
    rising = np.linspace(0.0, 1.0, 501)
    path = np.concatenate((rising, rising[::-1]))
    result: dict[str, list[float]] = {side: [] for side in SIDES}
    for seed in range(seeds):
        twin = BenchTwin(TwinParameters.draw(preset, seed), seed, active_channels=())
        for side, channel in zip(SIDES, CHANNELS, strict=False):
            scale = twin.nameplate(channel).nominal_torque_nm
            sweeps = [twin.static_sweep(side, sign * scale * path) for sign in (1.0, -1.0)]
            worst = max(float(np.max(np.abs(s.true_torque_nm - s.reading_nm))) for s in sweeps)
            result[side].append(100.0 * worst / scale)
    return result


def _main() -> None:
    mountings: tuple[Mounting, ...] = ("calibrator", "reducer")
    for mounting in mountings:
        for channels in (CHANNELS, ()):
            factor = speed(mounting, channels)
            print(f"{mounting:12s} {len(channels)} channels: {factor:5.0f} times real time")
    presets: tuple[Preset, ...] = ("nominal", "worn")
    for preset in presets:
        for side, errors in raw_errors(preset, 50).items():
            low, middle, high = np.quantile(errors, (0.0, 0.5, 1.0))
            print(
                f"{preset:8s} {side:6s} raw {low:.2f} / {middle:.2f} / {high:.2f} % FS (50 seeds)"
            )


if __name__ == "__main__":
    _main()
