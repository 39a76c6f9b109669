"""Messages about a measuring chain: its compensation, and influences missing in U."""

from __future__ import annotations

from typing import TYPE_CHECKING

from torquebench.cli.terminal.console import note, say

if TYPE_CHECKING:
    from collections.abc import Sequence

    from torquebench.bench.roles import Side
    from torquebench.chain import Timebase
    from torquebench.station import Station


def tell_missing(missing: Sequence[str], side: str = "") -> None:
    """List the influences that U doesn't contain, because they weren't measured.

    Without a side it is printed as part of the results, with a bench's side as a note before them.
    """
    from torquebench.chain import not_in_u

    sentence = not_in_u(missing)
    if sentence is not None:
        if side:
            note(f"{side}: {sentence}")
        else:
            say(sentence)


def compensated(station: Station, side: Side, accepted: Timebase | None = None) -> str:
    """Activate a side's compensation if it has an active model, and describe it."""
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
    """Activate the sides' compensations, and print which, and which influences U lacks.

    Returns
    -------
    compensation, missing : dict
        Descriptions and missing influences by side; without compensation none are missing.
    """
    states = {side: compensated(station, side, accepted) for side in sides}
    missing = {}
    for side, state in states.items():
        active = station.acquisition.compensation(side)
        missing[side] = [] if active is None else list(active.chain.missing())
        note(f"{side}: {state}")
        tell_missing(missing[side], side)
    return states, missing
