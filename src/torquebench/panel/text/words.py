"""English texts of what the software knows by a short name."""

from collections.abc import Mapping

__all__ = ["ALARM_REMEDIES", "ALARM_TITLES", "JOB_STATES", "Texts"]

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
ALARM_REMEDIES: Texts = {
    "torque limit": "Look for a jam or an overload of the chain. Unload before you touch anything.",
    "speed limit": "Look for a loose coupling and a wrong speed in the test's settings.",
    "angle limit": "Check whether the shaft slips or the test turns further than its settings "
    "allow.",
    "rate limit": "Look for a coupling that slips or a part that breaks, then load more slowly.",
    "temperature limit": "Let the bench cool down and look at its cooling and lubrication.",
    "signal lost": "Look at the transducer's cable, plug and supply. A missing signal is never "
    "zero torque.",
    "signals disagree": "Two signals of the same quantity differ. Look for a slipping coupling, "
    "a loose cable or a swapped channel.",
    "drive fault": "Read the fault on the drive, remove its cause, reset the drive.",
    "command not followed": "Look at the drive's enable, supply and settings. It didn't follow "
    "its command; don't use it until you know the cause.",
    "journal failed": "Make room on the disk or repair it, then repeat the run.",
    "audit log failed": "Make room on the disk or repair it before anything is moved.",
    "registry behind": "Check whether the registry's server runs and its disk has room. It "
    "catches up by itself.",
    "heartbeat missing": "Wait until the computer is less busy. If it happens again, restart the "
    "panel.",
    "operator missing": "Come back to the bench and confirm that you are there.",
    "acquisition stalled": "Look at the counter, its cable and its supply, then restart the panel.",
    "supervisor failed": "Restart the panel. If it happens again, report it with the audit log.",
    "instrument failed": "Look at the instrument's supply and connection, then restart the panel.",
    "stop requested": "Ask why it was stopped. Acknowledge when the bench is safe to move.",
    "not in the safe state": "Press the emergency stop and keep away from the bench. Find out "
    "why the drive doesn't switch off; the alarm can be acknowledged when power and torque are "
    "read as gone.",
}
"""What to do after an alarm of a kind."""
