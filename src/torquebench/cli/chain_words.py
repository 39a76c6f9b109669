"""Messages of commands about a measuring chain: its compensation, and what U doesn't contain."""

from __future__ import annotations

from typing import TYPE_CHECKING

from torquebench.cli.terminal.console import note, say

if TYPE_CHECKING:
    from collections.abc import Sequence

    from torquebench.bench.roles import Side
    from torquebench.chain import Timebase
    from torquebench.station import Station

__all__ = ["compensated", "tell_compensation", "tell_missing"]


def tell_missing(missing: Sequence[str], side: str = "") -> None:
    """List the influences that U doesn't contain, because nothing is recorded of them.

    Without a side it is part of the results; of a side on the bench, a note before them.
    """
    from torquebench.chain import not_in_u

    sentence = not_in_u(missing)
    if sentence is not None:
        if side:
            note(f"{side}: {sentence}")
        else:
            say(sentence)


def compensated(station: Station, side: Side, accepted: Timebase | None = None) -> str:
    """Compensate a side by its active model if there is one, and say by which."""
    from torquebench.errors import ModelMismatchError

    try:
        active = station.activate_compensation(side, accepted)
    except ModelMismatchError as error:
        return f"not compensated, {error.found}"
    made = ""
    if active.accepted is not None:
        made = (
            f", made with {active.accepted.identity}: {active.accepted.tolerance_ppm:g} ppm added"
        )
    return f"compensated by model-{active.model_id} ({active.kind}){made}"


def tell_compensation(
    station: Station, sides: Sequence[Side], accepted: Timebase | None = None
) -> tuple[dict[Side, str], dict[Side, list[str]]]:
    """Compensate sides by their active models; say by which, and what U doesn't contain.

    Returns
    -------
    compensation, missing : dict
        The same by side; nothing is missing where no U is stated.
    """
    states = {side: compensated(station, side, accepted) for side in sides}
    missing = {}
    for side, state in states.items():
        active = station.acquisition.compensation(side)
        missing[side] = [] if active is None else list(active.chain.missing())
        note(f"{side}: {state}")
        tell_missing(missing[side], side)
    return states, missing
