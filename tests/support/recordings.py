"""Recordings of reducers with known truth, as strangers bring them.

Written from the definitions of the quantities alone: nothing of the evaluation and none of the
simulated bench's numbers are used. Angles are in arcmin, torques in N·m, speeds in 1/min.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Generator = np.random.Generator


# -- torque-angle loops -----------------------------------------------------------------------


@dataclass(frozen=True)
class Loop:
    """A steady loop: angle of the rising and the falling branch over torque, and the virgin curve.

    `rated` is the largest torque; `share` is that of lost motion.
    """

    rising: Callable[[Floats], Floats]
    falling: Callable[[Floats], Floats]
    virgin: Callable[[Floats], Floats]
    rated: float
    share: float = 0.03

    def truth(self) -> dict[str, float]:
        """Return what the definitions give, in arcmin, N·m/arcmin and J."""
        fine = np.linspace(-self.rated, self.rated, 200_001)
        at = self.share * self.rated * np.array([1.0, -1.0])
        middle = 0.5 * (self.rising(at) + self.falling(at))
        load = np.linspace(0.5 * self.rated, self.rated, 20_001)
        positive = 1.0 / np.polyfit(load, self.rising(load), 1)[0]
        negative = 1.0 / np.polyfit(-load, self.falling(-load), 1)[0]
        zero = np.zeros(1)
        area = np.trapezoid(self.falling(fine) - self.rising(fine), fine)
        return {
            "backlash": float(self.falling(zero)[0] - self.rising(zero)[0]),
            "lost_motion": float(middle[0] - middle[1]),
            "stiffness": float(2.0 / (1.0 / positive + 1.0 / negative)),
            "stiffness_positive": float(positive),
            "stiffness_negative": float(negative),
            "hysteresis_loss": float(area * np.pi / 10800.0),
        }


SHAPES = ("line", "lens", "play", "gap", "stiffening", "friction", "steep")


def loop(shape: str, rng: Generator) -> Loop:
    """Return a loop of a shape, with random stiffness, widths and softness."""
    rated = float(rng.choice([20.0, 100.0, 412.0, 1500.0]))
    twist = rng.uniform(3.0, 12.0)  # at the rated torque
    stiffness = rated / twist
    width = rng.uniform(0.02, 0.12) * twist
    uneven = 1.0 + 0.05 * rng.standard_normal()

    if shape == "friction":  # an elastic part before a dry friction that has to be reversed
        force = rng.uniform(0.01, 0.06) * rated

        def rising(torque: Floats) -> Floats:
            return np.maximum(torque - force, -rated + force) / stiffness

        def falling(torque: Floats) -> Floats:
            return np.minimum(torque + force, rated - force) / stiffness

        def fresh(torque: Floats) -> Floats:
            return np.maximum(torque - force, 0.0) / stiffness

        return Loop(rising, falling, fresh, rated)
    bend = rng.uniform(0.1, 0.3) if shape == "stiffening" else 0.0
    low, high, soft = {
        "lens": (0.0, 0.1, rng.uniform(0.03, 0.15)),
        "play": (0.1, 0.5, 0.004),
        "gap": (0.1, 0.5, 0.012),
    }.get(shape, (0.0, 0.0, 1.0))
    gap = rng.uniform(low, high) * twist
    # Torque of the idle parts, by which both branches pass the gap apart from each other.
    lag = {"play": rng.uniform(0.01, 0.015), "gap": rng.uniform(0.07, 0.1)}.get(shape, 0.0)
    if shape == "steep":
        gap, lag = rng.uniform(0.05, 0.5) * twist, rng.uniform(0.0, 0.02)
        soft = 0.01 * 12.0 ** rng.uniform()

    def branch(torque: Floats, side: float) -> Floats:
        share = torque / rated
        elastic = torque / stiffness * (1.0 + bend * (1.0 - np.abs(share)) ** 2)
        if shape != "line":
            elastic = elastic * np.where(torque > 0.0, uneven, 1.0)
        passed = 0.5 * gap * np.tanh((share + side * lag) / soft)
        return np.asarray(elastic + passed + side * 0.5 * width * (1.0 - share**2))

    def up(torque: Floats) -> Floats:
        return branch(torque, -1.0)

    def down(torque: Floats) -> Floats:
        return branch(torque, 1.0)

    def begun(torque: Floats) -> Floats:
        joined = np.clip(torque / rated, 0.0, 1.0)
        return joined * up(torque) + (1.0 - joined) * 0.5 * (up(torque) + down(torque))

    return Loop(up, down, begun, rated)


@dataclass(frozen=True)
class LoopRecord:
    """Columns of a recording of loops, and the step of its angle."""

    time: Floats
    torque: Floats
    angle: Floats
    step: float = 0.0
    bad_row: int | None = None


def loop_record(
    shape: Loop,
    rng: Generator,
    *,
    loops: int = 3,
    samples: int = 300,
    noise: float = 0.0,
    torque_noise: float = 0.0,
    step: float = 0.0,
    torque_step: float = 0.0,
    levels: int = 0,
    dwell: int = 5,
    drift: float = 0.0,
    bending: float = 0.0,
    bad: str = "",
    single: bool = False,
) -> LoopRecord:
    """Record a loop −T → +T → −T, or with `single` the cycle 0 → +T → −T → 0.

    Noise, steps and drift (per loop) of the angle are in shares of the twist at the rated torque,
    those of the torque in shares of the rated torque. `bending` is the share of the drift that
    dies out within a loop. `bad` spoils one sample of "torque" or "angle".
    """
    rated = shape.rated
    twist = float(shape.falling(np.array([rated]))[0])
    half = np.linspace(-1.0, 1.0, samples)
    if levels:
        half = np.repeat(np.linspace(-1.0, 1.0, 2 * levels + 1), dwell)
    rise, fall = half * rated, half[::-1] * rated
    torque, angle = [], []
    if single:
        up, down = rise[rise >= 0.0], rise[rise <= 0.0]
        torque = [up, fall, down]
        angle = [shape.virgin(up), shape.falling(fall), shape.rising(down)]
    else:
        for _ in range(loops):
            torque += [rise, fall]
            angle += [shape.rising(rise), shape.falling(fall)]
    load, twisted = np.concatenate(torque), np.concatenate(angle)
    time = 0.05 * np.arange(load.size, dtype=np.float64)
    place = np.linspace(0.0, float(loops), load.size)
    creep = (1.0 - bending) * place + bending * (1.0 - np.exp(-place)) * loops / (
        1.0 - np.exp(-loops)
    )
    twisted = twisted + drift * twist * creep
    twisted = twisted + noise * twist * rng.standard_normal(load.size)
    read = load + torque_noise * rated * rng.standard_normal(load.size)
    if step:
        size = step * twist
        twisted = np.floor(twisted / size + rng.uniform()) * size
    if torque_step:
        read = np.round(read / (torque_step * rated)) * torque_step * rated
    row = None
    if bad:
        row = int(rng.integers(5, load.size - 5))
        spoilt = read if bad == "torque" else twisted
        size = rated if bad == "torque" else twist
        spoilt[row] += float(rng.choice([-1.0, 1.0])) * size * rng.uniform(0.3, 20.0)
    return LoopRecord(time, read, twisted, step * twist, row)


# -- break-away -------------------------------------------------------------------------------


@dataclass(frozen=True)
class RampRecord:
    """Columns of several ramps up to a slip, and the torque that the reducer held."""

    run: Floats
    time: Floats
    angle: Floats
    torque: Floats
    truth: float
    bad_row: int | None = None


def ramp_record(
    rng: Generator,
    *,
    runs: int = 3,
    samples: int = 600,
    drop: float = 0.0,
    noise: float = 0.001,
    angle_noise: float = 0.3,
    step: float = 0.0,
    levels: int = 0,
    softening: float = 1.0,
    windup: float = 0.0,
    spread: float = 0.0,
    both: bool = False,
    bad: str = "",
) -> RampRecord:
    """Record ramps of torque until the reducer slips; angles in arcmin.

    At the slip the torque falls by the share `drop`, and rises after it at `softening` of its rate.
    `windup` is the elastic angle at the slip; `levels` makes a staircase of so many steps up to
    about the slip; `spread` scatters what each ramp holds.
    """
    held = float(rng.choice([0.03, 0.3, 8.0, 60.0])) * rng.uniform(0.7, 1.3)
    rest = int(samples * rng.uniform(0.6, 0.85))
    columns: list[Floats] = []
    for number in range(runs):
        mine = held * (1.0 + spread * rng.standard_normal())
        interval = float(rng.choice([0.002, 0.01, 0.05]))
        time = interval * np.arange(samples, dtype=np.float64)
        if levels:
            size = held / levels
            dwell = max(rest // levels, 6)
            stair = size * (rng.uniform(0.2, 1.0) + np.arange(samples) // dwell)
            start = int(np.argmax(stair >= mine))
            load = stair
            begin = time[start]
        else:
            rate = mine / (rest * interval + rng.uniform() * interval)
            begin = mine / rate
            load = rate * time
        after = np.maximum(time - begin, 0.0)
        slipped = time > begin
        fallen = mine if not levels else float(load[start])
        load = np.where(slipped, fallen * (1.0 - drop) + softening * (load - fallen), load)
        if levels:
            load = np.where(slipped, fallen * (1.0 - drop), load)
        span = (samples - rest) * interval
        moved = rng.uniform(100.0, 400.0) * (after / span) ** float(rng.choice([2.0, 3.0]))
        angle = windup * load / held + moved
        angle = angle + angle_noise * rng.standard_normal(samples)
        if step:
            angle = np.floor(angle / step) * step
        sign = -1.0 if both and number % 2 else 1.0
        load = load + noise * held * rng.standard_normal(samples)
        columns.append(
            np.array(
                [np.full(samples, number + 1.0), time + 10.0 * number, sign * angle, sign * load]
            )
        )
    run, time, angle, load = np.concatenate(columns, axis=1)
    row = None
    if bad:
        row = int(rng.integers(5, samples // 2)) + samples * int(rng.integers(0, runs))
        spoilt = load if bad == "torque" else angle
        spoilt[row] += float(rng.choice([-1.0, 1.0])) * (held if bad == "torque" else 1000.0)
    return RampRecord(run, time, angle, load, held, row)


# -- running torque ---------------------------------------------------------------------------


@dataclass(frozen=True)
class FrictionTruth:
    """Friction with Coulomb, viscous and Stribeck parts, N·m over 1/min."""

    coulomb: float
    viscous: float
    stribeck: float
    creep_rpm: float

    def at(self, speed: Floats) -> Floats:
        """Return the torque at speeds, with their signs."""
        size = np.abs(speed)
        decay = np.exp(-((size / self.creep_rpm) ** 2))
        torque = self.coulomb + self.viscous * size + self.stribeck * decay
        return np.asarray(np.sign(speed) * torque)


@dataclass(frozen=True)
class SpeedRecord:
    """Columns of a sweep of speeds, and what is true."""

    speed: Floats
    torque: Floats
    demanded: Floats
    truth: FrictionTruth
    offset: float
    bad_row: int | None = None


def friction_truth(rng: Generator, *, stribeck: bool = True) -> FrictionTruth:
    """Return a friction of random size."""
    coulomb = float(rng.choice([0.03, 0.3, 4.0])) * rng.uniform(0.7, 1.3)
    fastest = 2000.0
    viscous = coulomb * rng.uniform(0.3, 1.2) / fastest
    extra = coulomb * rng.uniform(0.2, 0.5) if stribeck else 0.0
    return FrictionTruth(coulomb, viscous, extra, rng.uniform(60.0, 150.0))


def speed_record(
    rng: Generator,
    *,
    speeds: int = 12,
    repeats: int = 3,
    both: bool = True,
    noise: float = 0.005,
    offset: float = 0.0,
    places: int | None = None,
    log: int = 0,
    ramp: bool = False,
    stribeck: bool = True,
    wander: float = 0.001,
    bad: str = "",
) -> SpeedRecord:
    """Record the torque over speed: points, a log with so many samples at each speed, or a ramp.

    Noise and offset are in shares of the Coulomb torque; `wander` is that of the set speed.
    """
    truth = friction_truth(rng, stribeck=stribeck)
    steps = np.geomspace(20.0, 2000.0, speeds)
    path = np.concatenate([steps, steps[::-1]]) if repeats > 1 else steps
    path = np.tile(path, max(repeats // 2, 1))
    if repeats % 2 and repeats > 1:
        path = np.concatenate([path, steps])
    if both:
        path = np.concatenate([path, -path])
    if ramp:
        up = np.linspace(20.0, 2000.0, 600)
        path = np.concatenate([up, up[::-1]])
        path = np.concatenate([path, -path]) if both else path
        speed = path.copy()
    else:
        speed = path * (1.0 + wander * rng.standard_normal(path.size))
    if log:
        parts, before = [], 0.0
        for target in speed:
            parts += [np.linspace(before, target, 25), np.full(log, target)]
            before = target
        path = np.concatenate(parts)
        speed = path + 0.002 * 2000.0 * rng.standard_normal(path.size)
        torque = truth.at(np.where(np.abs(path) < 1.0, 0.0, path))
        torque = torque + 3.0 * np.gradient(path) / 2000.0 * truth.coulomb  # inertia
    else:
        torque = truth.at(speed)
    shift = offset * truth.coulomb
    torque = torque + shift + noise * truth.coulomb * rng.standard_normal(torque.size)
    if places is not None:
        torque = np.round(torque, places)
    row = None
    if bad:
        row = int(rng.integers(0, torque.size))
        torque[row] += float(rng.choice([-1.0, 1.0])) * truth.coulomb * rng.uniform(2.0, 30.0)
    return SpeedRecord(speed, torque, path, truth, shift, row)


# -- efficiency -------------------------------------------------------------------------------


@dataclass(frozen=True)
class EfficiencyRecord:
    """Columns of a map, the ratio, and the true efficiency at a torque and a speed."""

    drive: Floats
    load: Floats
    speed: Floats
    demanded_nm: Floats
    demanded_rpm: Floats
    ratio: float
    truth: Callable[[float, float], float]
    bad_row: int | None = None


def efficiency_record(
    rng: Generator,
    *,
    torques: int = 4,
    speeds: int = 3,
    repeats: int = 3,
    noise: float = 0.002,
    wander: float = 0.001,
    both: bool = False,
    offset: float = 0.0,
    log: int = 0,
    bad: bool = False,
    places: int | None = None,
) -> EfficiencyRecord:
    """Record input and output torque at a grid of torques and speeds, in any order of repeats.

    Noise is that of the input torque in shares of its largest, `offset` its zero's error.
    """
    ratio = float(rng.choice([10.0, 50.0, 121.0]))
    rated = float(rng.choice([20.0, 400.0]))
    idle, loss, speed_loss = (
        rng.uniform(0.02, 0.08),
        rng.uniform(0.03, 0.15),
        rng.uniform(0.0, 0.05),
    )

    def drive_of(load: Floats, speed: Floats) -> Floats:
        lost = idle * (1.0 + speed_loss * speed / 1000.0 * 4.0)
        return (load * (1.0 + loss) + lost * rated) / ratio

    def truth(load: float, speed: float) -> float:
        at = drive_of(np.array(load), np.array(abs(speed)))
        return float(100.0 * load / ratio / at)

    loads = rated * np.linspace(0.25, 1.0, torques)
    rates = np.linspace(300.0, 1500.0, speeds)
    grid = [(t, s) for _ in range(repeats) for t in loads for s in rates]
    if both:
        grid += [(t, -s) for t, s in grid]
    set_load, set_speed = np.array(grid).T
    load = set_load * (1.0 + wander * rng.standard_normal(set_load.size))
    speed = set_speed * (1.0 + wander * rng.standard_normal(set_load.size))
    if log:
        ramped = []
        before = (0.0, 0.0)
        for target in zip(load, speed, strict=True):
            ramped.append(np.linspace(before, target, 20))
            ramped.append(np.tile(target, (log, 1)))
            before = target
        load, speed = np.concatenate(ramped).T
        set_load, set_speed = load, speed
    sign = np.sign(speed)
    drive = drive_of(load, np.abs(speed)) * sign
    largest = float(np.max(np.abs(drive)))
    drive = drive + largest * (noise * rng.standard_normal(drive.size) + offset)
    pulled = load * sign + noise * rated * 0.2 * rng.standard_normal(load.size)
    if log:
        speed = speed + 2.0 * rng.standard_normal(speed.size)
    if places is not None:
        drive, pulled = np.round(drive, places), np.round(pulled, places)
    row = None
    if bad:
        row = int(rng.integers(0, drive.size))
        drive[row] *= float(rng.choice([0.2, 3.0, 10.0]))
    return EfficiencyRecord(drive, pulled, speed, set_load, set_speed, ratio, truth, row)


# -- two encoders -----------------------------------------------------------------------------


@dataclass(frozen=True)
class AngleRecord:
    """Both angles in degrees, the ratio, and what is true, in arcsec and arcmin."""

    time: Floats
    driving: Floats
    driven: Floats
    ratio: float
    peak_to_peak: float
    orders: dict[float, float]
    lost_motion: float = 0.0
    backlash: float = 0.0
    bad_row: int | None = None


def angle_record(
    rng: Generator,
    *,
    turns: float = 1.05,
    samples: int = 4000,
    size: float = 20.0,
    orders: int = 5,
    highest: float = 60.0,
    strongest: float | None = None,
    noise: float = 0.2,
    step: float = 0.0,
    both: bool = True,
    play: float = 0.0,
    slip: float = 0.0,
    wrong: float = 0.0,
    bad: bool = False,
    wrapped: bool = False,
    ratio: float | None = None,
) -> AngleRecord:
    """Record whole output turns; sizes, noise, encoder step, play and slip in arcsec.

    `strongest` is an order with a hundred times the size of the others; `wrong` a relative error of
    the ratio by which the angles really turn.
    """
    stated = float(rng.choice([-100.0, -41.0, 10.0, 41.0, 81.0])) if ratio is None else ratio
    numbers = [
        float(each) for each in rng.choice(np.arange(1, int(highest)), orders, replace=False)
    ]
    parts = {number: size * rng.uniform(0.2, 1.0) for number in numbers}
    if strongest is not None:
        parts[strongest] = 100.0 * size
    phases = {number: rng.uniform(0.0, 2.0 * np.pi) for number in parts}

    def error(phi: Floats) -> Floats:
        waves = [a * np.sin(k * phi + phases[k]) for k, a in parts.items()]
        return np.asarray(np.sum(waves, axis=0))

    place = rng.uniform(0.0, 6.0)
    strokes = (1.0, -1.0) if both else (float(rng.choice([-1.0, 1.0])),)
    driving, driven = [], []
    real = stated * (1.0 + wrong)
    for direction in strokes:
        phi = place + direction * np.linspace(0.0, 2.0 * np.pi * turns, samples)
        place = phi[-1]
        off = error(phi) - 0.5 * direction * play
        off = off + slip * (np.arange(samples) > rng.uniform(0.3, 0.7) * samples)
        driven.append(phi)  # the error belongs to the output's own angle
        driving.append(real * (phi - np.radians(off / 3600.0)))
    given, taken = np.degrees(np.concatenate(driving)), np.degrees(np.concatenate(driven))
    taken = taken + noise / 3600.0 * rng.standard_normal(taken.size)
    if step:
        taken = np.floor(taken / (step / 3600.0)) * (step / 3600.0)
    row = None
    if bad:
        row = int(rng.integers(5, taken.size - 5))
        taken[row] += float(rng.choice([-1.0, 1.0])) * rng.uniform(0.1, 100.0)
    if wrapped:
        given, taken = given % 360.0, taken % 360.0
    fine = np.linspace(0.0, 2.0 * np.pi, 200_001)
    time = 0.001 * np.arange(given.size, dtype=np.float64)
    return AngleRecord(
        time, given, taken, stated, float(np.ptp(error(fine))), parts, play / 60.0, play / 60.0, row
    )


def swing_record(
    rng: Generator,
    *,
    strokes: int = 6,
    samples: int = 800,
    reach: float = 30.0,
    play: float = 4.0,
    soft: float = 0.0,
    noise: float = 0.1,
    step: float = 0.0,
    size: float = 1.0,
    wrong: float = 0.0,
    bad: bool = False,
    shape: str = "sine",
) -> AngleRecord:
    """Record a reciprocating motion of so many degrees at the output; other sizes in arcmin.

    `play` is the dead band; `soft` a further part of the lost motion, taken up elastically.
    """
    ratio = float(rng.choice([-30.0, 7.2, 14.0, 100.0]))
    swing = np.linspace(0.0, np.pi, samples, endpoint=False)
    wave = -np.cos(swing) if shape == "sine" else np.linspace(-1.0, 1.0, samples, endpoint=False)
    parts = [wave if k % 2 == 0 else -wave for k in range(strokes)]
    phi = 0.5 * reach * 60.0 * np.concatenate(parts)  # arcmin
    phases = rng.uniform(0.0, 2.0 * np.pi, 2)
    held, lag = phi[0] + 0.5 * play, np.empty(phi.size)
    elastic = 0.0
    for k, place in enumerate(phi):
        before = held
        held = min(max(held, place - 0.5 * play), place + 0.5 * play)
        moved = held - before
        if soft:
            elastic += 0.5 * moved
            elastic = min(max(elastic, -0.5 * soft), 0.5 * soft)
        lag[k] = held - elastic
    turned = np.radians(lag / 60.0)
    error = size * (np.sin(turned + phases[0]) + 0.5 * np.sin(ratio * turned + phases[1]))
    driven = lag + error + noise * rng.standard_normal(phi.size)
    if step:
        driven = np.floor(driven / step) * step
    row = None
    if bad:
        row = int(rng.integers(5, driven.size - 5))
        driven[row] += float(rng.choice([-1.0, 1.0])) * rng.uniform(100.0, 3000.0)
    driving = ratio * (1.0 + wrong) * phi
    time = 0.002 * np.arange(phi.size, dtype=np.float64)
    return AngleRecord(time, driving / 60.0, driven / 60.0, ratio, 0.0, {}, play + soft, play, row)
