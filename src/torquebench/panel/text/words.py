"""English texts of what the software knows by a short name."""

from collections.abc import Mapping

Texts = Mapping[str, str]
"""English texts by short names; a test compares every mapping of this type with the Chinese."""

JOB_STATES: Texts = {
    "running": "under way",
    "pausing": "pausing at the next point",
    "paused": "paused, no torque",
    "aborting": "aborting",
    "done": "done",
    "failed": "failed",
    "aborted": "aborted",
    "interrupted": "interrupted by the end of the server",
}
ALARM_TITLES: Texts = {
    "rate limit": "Torque changes too fast",
    "journal failed": "Recording failed",
    "heartbeat missing": "Program doesn't answer",
    "operator missing": "Nobody at the bench",
    "acquisition stalled": "No measured values",
    "supervisor failed": "Safety supervisor failed",
    "stop requested": "Stopped by a person",
    "not in the safe state": "A drive isn't off",
}
"""Titles of kinds of alarms that say more than the kind's own name."""
