"""What results of measurements have in common."""

from enum import StrEnum

__all__ = ["Shared"]


class Shared(StrEnum):
    """Conditions under which two torques, or two results by torques, share an error."""

    CALIBRATION = "calibration"
    MOUNTING = "mounting"
    ZEROING = "zeroing"
    LOADING = "loading"
    NOTHING = "nothing"
