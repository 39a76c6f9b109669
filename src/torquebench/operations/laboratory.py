"""State the laboratory and its customer for certificates: `laboratory.toml` of the data."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Annotated, Any

from torquebench.message import Message
from torquebench.operations.operation import Operation, Request, field
from torquebench.operations.place import Place
from torquebench.operations.result import Result
from torquebench.progress import Progress
from torquebench.reports.page import Facts, Page, Section

CUSTOMER = "customer_"


def _line(words: str) -> Any:
    return field(words, max_length=200)


class LaboratoryRequest(Request):
    """State the laboratory that issues certificates, and its customer.

    Without a customer's name, the laboratory is its own customer. The people and the policy that
    the file already states are kept.
    """

    basic = ("name", "city", "country", "customer_name", "customer_city", "customer_country")

    name: Annotated[
        str, field("Laboratory that issues certificates.", min_length=1, max_length=200)
    ]
    city: Annotated[str, field("Its city.", min_length=1, max_length=200)]
    country: Annotated[str, field("Its country by two letters, such as DE or CN.",
                                  pattern="^[A-Z]{2}$")]  # fmt: skip
    street: Annotated[str, _line("Its street and number.")] = ""
    post_code: Annotated[str, _line("Its post code.")] = ""
    email: Annotated[str, _line("Its e-mail address.")] = ""
    customer_name: Annotated[str, _line("Customer of the certificates.")] = ""
    customer_city: Annotated[str, _line("The customer's city.")] = ""
    customer_country: Annotated[
        str,
        field("The customer's country by two letters, such as DE or CN.", pattern="^([A-Z]{2})?$"),
    ] = ""
    customer_street: Annotated[str, _line("The customer's street and number.")] = ""
    customer_post_code: Annotated[str, _line("The customer's post code.")] = ""
    customer_email: Annotated[str, _line("The customer's e-mail address.")] = ""

    @property
    def parties(self) -> dict[str, dict[str, str]]:
        """Laboratory and, if there is one, customer, with the values that are stated."""
        values = {name: value for name, value in dict(self).items() if value}
        customer = {name.removeprefix(CUSTOMER): value for name, value in values.items()
                    if name.startswith(CUSTOMER)}  # fmt: skip
        laboratory = {
            name: value for name, value in values.items() if not name.startswith(CUSTOMER)
        }
        return {"laboratory": laboratory} | ({"customer": customer} if customer else {})


@dataclass(frozen=True, kw_only=True)
class StatedLaboratory(Result):
    """The laboratory and its customer, as certificates state them."""

    laboratory: dict[str, str]
    customer: dict[str, str]

    def page(self) -> Page:
        """Return their data."""
        sections = [
            Section(title, "", [Facts([(key.replace("_", " "), value) for key, value in facts])])
            for title, facts in (
                ("Laboratory", list(self.laboratory.items())),
                ("Customer", list(self.customer.items())),
            )
            if facts
        ]
        return Page("Laboratory and customer", "", sections)


def run_laboratory(
    place: Place, request: LaboratoryRequest, _progress: Progress
) -> StatedLaboratory:
    """Write the file, and keep what else it states."""
    from torquebench.atomic_write import atomic_write
    from torquebench.reports.certificate.laboratory import (
        LABORATORY_FILE,
        Letterhead,
        kept_letterhead,
    )
    from torquebench.validation import validated

    path = place.folder / LABORATORY_FILE
    before = kept_letterhead(place.folder)
    tables: dict[str, dict[str, Any]] = dict(request.parties)
    if before.people:
        tables["laboratory"] = {**tables["laboratory"], "people": list(before.people)}
    tables["policy"] = before.policy.model_dump(exclude_defaults=True)
    validated(Letterhead, tables, str(path))
    # A JSON string or list of strings is one of TOML, too.
    text = "\n".join(
        f"[{table}]\n" + "".join(f"{key} = {json.dumps(value)}\n" for key, value in values.items())
        for table, values in tables.items()
        if values
    )
    atomic_write(path, text)
    return StatedLaboratory(
        headline=Message("Certificates name {laboratory}.", request.name),
        laboratory=request.parties["laboratory"],
        customer=request.parties.get("customer", {}),
    )


LABORATORY = Operation(
    "records laboratory",
    LaboratoryRequest,
    run_laboratory,
    lambda _request: "Laboratory and customer",
    where="folder",
    role="administrator",
    quick=True,
)
