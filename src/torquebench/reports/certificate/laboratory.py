"""The issuing laboratory and its customer: a small TOML file."""

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.records.accounts import Accounts
from torquebench.reports.certificate.record import Party
from torquebench.validation import parse_toml, validated

LABORATORY_FILE = "laboratory.toml"
"""Name of the file in a data directory."""

_SHAPE = (
    '[laboratory] with name, city and country ("DE"), and optionally [customer] with the same keys'
)


class _Party(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", str_strip_whitespace=True)

    name: str = Field(min_length=1)
    street: str = ""
    post_code: str = ""
    city: str = Field(min_length=1)
    country: str = Field(pattern="^[A-Z]{2}$")
    email: str = ""

    def party(self) -> Party:
        return Party(**self.model_dump(exclude={"people"}))


class _Laboratory(_Party):
    people: tuple[Annotated[str, Field(min_length=1)], ...] = ()


class _Policy(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")

    unreviewed: Literal["state", "refuse"] = "refuse"
    signatures: Literal["state", "require"] | None = None


class Letterhead(BaseModel):
    """The issuing laboratory and its customer; without a customer, the laboratory itself.

    `laboratory.people` are the persons who measure, review and sign. `policy.unreviewed` determines
    whether an unreviewed certificate is refused or issued with a statement on every page;
    `policy.signatures`, whether typed reviews and authorisations count. The simulated bench needs
    no laboratory, but may have a policy.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    laboratory: _Laboratory | None = None
    customer: _Party | None = None
    policy: _Policy = _Policy()

    @property
    def parties(self) -> tuple[Party, Party]:
        """Laboratory and customer; both empty without a laboratory."""
        laboratory = Party() if self.laboratory is None else self.laboratory.party()
        return laboratory, laboratory if self.customer is None else self.customer.party()

    @property
    def people(self) -> tuple[str, ...]:
        """The people of the laboratory."""
        return () if self.laboratory is None else self.laboratory.people

    @property
    def refuses_unreviewed(self) -> bool:
        """Whether unreviewed certificates are refused."""
        return self.policy.unreviewed == "refuse"

    def requires_signatures(self, root: Path) -> bool:
        """Whether reviews and authorisations must be signed; by default only if accounts exist."""
        if self.policy.signatures is None:
            return bool(Accounts.of(root))
        return self.policy.signatures == "require"


def kept_letterhead(root: Path) -> Letterhead:
    """Read the laboratory of a data directory; without a file, return the strict default.

    Raises
    ------
    InputError
        Where the file is invalid; the message names the key.
    """
    path = root / LABORATORY_FILE
    return read_letterhead(path) if path.is_file() else Letterhead()


def person_among(name: str, people: Iterable[str], what: str = "measured by") -> str:
    """Return the laboratory's spelling of a person's name.

    Raises
    ------
    InputError
        Where the laboratory has no person of this name.

    Examples
    --------
    >>> person_among(" a. kim", ["A. Kim", "B. Li"])
    'A. Kim'
    """
    known = list(dict.fromkeys(people))
    for each in known:
        if each.strip().casefold() == name.strip().casefold():
            return each
    raise InputError(
        Message("{what} {name!r}, who isn't a person of the laboratory", what, name.strip()[:80]),
        Message("one of {list}", ", ".join(known)) if known else "a person of the laboratory",
        Message(
            'name them in {laboratory_file}: people = ["A. Kim", …] under [laboratory]',
            LABORATORY_FILE,
        ),
    )


def read_letterhead(path: Path) -> Letterhead:
    """Read laboratory and customer.

    Parameters
    ----------
    path : pathlib.Path
        A TOML file with the table ``[laboratory]`` (name, street, post_code, city, country, email,
        people), optionally ``[customer]``, and optionally ``[policy]`` with ``unreviewed =
        "state"`` or ``signatures = "require"``.

    Raises
    ------
    InputError
        Where the file is invalid; the message names file and key.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(
            Message("laboratory {path}: {error}", path, error),
            Message("a TOML file in UTF-8 with {content}", _SHAPE),
        ) from error
    return validated(Letterhead, parse_toml(text, str(path)), str(path))
