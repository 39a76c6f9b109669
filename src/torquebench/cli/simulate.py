"""`torquebench simulate`: simulate a bench's instruments with their real protocols."""

from __future__ import annotations

import contextlib
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated, Any

import typer

from torquebench.cli.terminal.console import narrow_table, note, out, say
from torquebench.errors import BenchError, InputError
from torquebench.message import Message

if TYPE_CHECKING:
    from torquebench.bench.description import BenchDescription

READY = "Ready."
PROGRAM = "from torquebench.cli import main; main()"
START_TIMEOUT_S = 60.0


def simulate(
    bench: Annotated[
        Path, typer.Option("--bench", help="Bench description whose instruments are simulated.")
    ],
    real_time: Annotated[
        bool,
        typer.Option("--real-time", help="Follow the wall clock instead of advancing when read."),
    ] = False,
    until_eof: Annotated[
        bool, typer.Option("--until-eof", help="Also end when standard input ends.")
    ] = False,
    seed: Annotated[int | None, typer.Option(min=0, help="Overrides the description.")] = None,
    preset: Annotated[str | None, typer.Option(help="Overrides the description.")] = None,
) -> None:
    """Run a simulator of each instrument of a bench description at its address.

    Ctrl-C ends it. Any other command opens the same description from another terminal.
    """
    from torquebench.bench.description import load_bench

    description = described(load_bench(bench), seed=seed, preset=preset)
    if real_time:
        description = _changed(description, time="real")

    from torquebench.simulators import Simulators

    ending = threading.Event()

    def end(number: int, frame: FrameType | None) -> None:
        del number, frame
        ending.set()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, end)
    with Simulators(description) as simulators:
        table = narrow_table("Simulated instruments", headings=False)
        for role, address in simulators.addresses.items():
            table.add_row(role, address)
        out().print(table)
        say(READY)
        sys.stdout.flush()
        if until_eof:
            threading.Thread(target=_end_with_input, args=(ending,), daemon=True).start()
        while not ending.wait(0.5):
            pass
    note("simulators ended")


def _end_with_input(ending: threading.Event) -> None:
    sys.stdin.read()
    ending.set()


def described(
    description: BenchDescription, *, seed: int | None, preset: str | None
) -> BenchDescription:
    """Return a simulated bench's description with seed and preset of the command line."""
    changes: dict[str, Any] = {}
    if seed is not None:
        changes["seed"] = seed
    if preset is not None:
        changes["preset"] = preset
    return _changed(description, **changes) if changes else description


def _changed(description: BenchDescription, **changes: Any) -> BenchDescription:
    driver = dict(description.driver)
    if description.bench.driver == "simulated":
        driver |= changes
    elif "simulation" in driver:
        driver["simulation"] = {**driver["simulation"], **changes}
    else:
        raise InputError(
            Message("{name} has no instruments to simulate", description.name),
            "a bench with a section [driver.simulation]",
            "see examples/networked.toml",
        )
    return description.model_copy(update={"driver": driver})


@contextlib.contextmanager
def simulators_running(description: BenchDescription, bench: Path | None) -> Iterator[bool]:
    """Ensure that the simulators of a description run: use running ones, or start them.

    Yields whether this call started them; in that case they end with the block.

    Raises
    ------
    InputError
        Simulators with another seed or preset are running.
    BenchError
        The simulators can't be started.
    """
    if bench is None or "simulation" not in description.driver:
        yield False
        return
    wanted = description.simulation
    running = _status(str(wanted["control"]))
    if running is not None:
        for key in ("seed", "preset"):
            if key in wanted and running.get(key) != wanted[key]:
                raise InputError(
                    Message("simulators with {key} {running} are running", key, running.get(key)),
                    Message("{key} {wanted}", key, wanted[key]),
                    "end them, or leave the option out",
                )
        yield False
        return
    command = [sys.executable, "-c", PROGRAM, "simulate", "--bench", str(bench)]
    command += ["--until-eof"]
    for key in ("seed", "preset"):
        if key in wanted:
            command += [f"--{key}", str(wanted[key])]
    process = subprocess.Popen(
        command,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        # only the demo handles Ctrl-C; it needs the simulators to come to rest
        start_new_session=True,
    )
    try:
        assert process.stdout is not None
        if not any(line.strip() == READY for line in process.stdout):
            said = process.stderr.read().strip() if process.stderr else ""
            raise BenchError(
                Message("the simulators didn't start: {said}", said),
                "free ports and a complete description",
                Message("try `torquebench simulate --bench {bench}`", bench),
            )
        yield True
    finally:
        process.terminate()
        process.communicate(timeout=START_TIMEOUT_S)


def _status(control: str) -> dict[str, Any] | None:
    """Return the status of running simulators, None if there are none."""
    from torquebench.bench.drivers.simulated.control import SimulationControl

    channel = SimulationControl(control, timeout_s=2.0)
    try:
        return channel.ask("status")
    except BenchError:
        return None
    finally:
        channel.close()
