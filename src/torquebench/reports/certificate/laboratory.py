"""Who issues certificates and for whom: a small TOML file."""

from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from torquebench.errors import InputError
from torquebench.reports.certificate.record import Party
from torquebench.validation import parse_toml, validated

__all__ = ["LABORATORY_FILE", "Letterhead", "read_letterhead"]

LABORATORY_FILE = "laboratory.toml"
"""Where a data directory keeps it."""

_SHAPE = '[laboratory] with name, city and country ("DE"), and where wanted [customer] likewise'


class _Party(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", str_strip_whitespace=True)

    name: str = Field(min_length=1)
    street: str = ""
    post_code: str = ""
    city: str = Field(min_length=1)
    country: str = Field(pattern="^[A-Z]{2}$")
    email: str = ""

    def party(self) -> Party:
        return Party(**self.model_dump())


class _Policy(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")

    unreviewed: Literal["state", "refuse"] = "state"


class Letterhead(BaseModel):
    """The laboratory that issues, and the customer; the laboratory itself where none is given.

    `policy.unreviewed` is what becomes of a certificate that nobody has reviewed: every page
    states it, or it is refused.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    laboratory: _Party
    customer: _Party | None = None
    policy: _Policy = _Policy()

    @property
    def parties(self) -> tuple[Party, Party]:
        """Laboratory and customer."""
        return self.laboratory.party(), (self.customer or self.laboratory).party()


def read_letterhead(path: Path) -> Letterhead:
    """Read laboratory and customer.

    Parameters
    ----------
    path : pathlib.Path
        A TOML file with the table ``[laboratory]`` (name, street, post_code, city, country,
        email), where the customer is somebody else ``[customer]``, and where wanted ``[policy]``
        with ``unreviewed = "refuse"``.

    Raises
    ------
    InputError
        With file and key.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(
            f"laboratory {path}: {error}", "a TOML file in UTF-8 with " + _SHAPE
        ) from error
    return validated(Letterhead, parse_toml(text, str(path)), str(path))
