"""Data types of the settings: sections, documents and changes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Any, Literal

from pydantic import BaseModel

from torquebench.bench.description import BenchDescription
from torquebench.calibration import Profile, available_profiles, load_profile
from torquebench.errors import InputError
from torquebench.message import Message
from torquebench.operations import Role
from torquebench.panel.service.problems import NotFoundError
from torquebench.panel.service.settings.differences import Difference
from torquebench.reducers import ReducerDescription, available_reducers, load_reducer
from torquebench.validation import parse_toml

LARGEST_UPLOAD = 64 * 1024
BENCH = "bench"
"""Name of the only document in the section of the bench."""

SectionName = Literal["bench", "profiles", "reducers"]


@dataclass(frozen=True)
class Section:
    """A section of the settings: its documents, and the role that may change them."""

    name: SectionName
    role: Role
    model: type[BaseModel]


SECTIONS: Mapping[str, Section] = {
    section.name: section
    for section in (
        Section("bench", "administrator", BenchDescription),
        Section("profiles", "metrologist", Profile),
        Section("reducers", "metrologist", ReducerDescription),
    )
}


@dataclass(frozen=True)
class SettingsItem:
    """One document of a section.

    Parameters
    ----------
    section, name : str
        The bench's name is "bench".
    builtin : bool
        Whether it is packaged with the software; a copy under a new name can be changed.
    document : mapping
        Its content as JSON.
    version : int
        Number of the last change; 0 without changes.
    """

    section: str
    name: str
    builtin: bool
    document: Mapping[str, Any]
    version: int = 0


@dataclass(frozen=True)
class SettingsChange:
    """A change of the settings, made or previewed.

    Parameters
    ----------
    number : int
        0 for a preview.
    at : datetime.datetime or None
    who, section, name, reason : str
    differences : tuple of Difference
    undoes, undone_by : int or None
        Number of the change that this one undoes, or that undid this one.
    reopens : bool
        Whether the bench must be reopened to apply it.
    """

    number: int
    at: datetime | None
    who: str
    section: str
    name: str
    reason: str
    differences: tuple[Difference, ...]
    undoes: int | None = None
    undone_by: int | None = None
    reopens: bool = False


def read_upload(content: bytes) -> dict[str, Any]:
    """Return the document of an uploaded TOML file.

    Raises
    ------
    InputError
        The file is too large, or isn't TOML in UTF-8.

    Examples
    --------
    >>> read_upload(b'name = "slow"')
    {'name': 'slow'}
    """
    if len(content) > LARGEST_UPLOAD:
        raise InputError(
            Message("an upload of {count} bytes", len(content)),
            Message("at most {limit} bytes of TOML", LARGEST_UPLOAD),
        )
    try:
        text = content.decode("utf-8")
    except UnicodeDecodeError as error:
        raise InputError(
            Message("an upload that isn't UTF-8 at byte {place}", error.start), "UTF-8"
        ) from None
    return parse_toml(text, "the upload")


def find_section(name: str) -> Section:
    """Return a section by name.

    Raises
    ------
    NotFoundError
        The section doesn't exist.
    """
    if name not in SECTIONS:
        raise NotFoundError(Message("no settings {name!r}", name[:40]), ", ".join(SECTIONS))
    return SECTIONS[name]


def builtin_names(section: SectionName) -> tuple[str, ...]:
    """Return the names of the packaged documents."""
    if section == "profiles":
        return available_profiles()
    return available_reducers() if section == "reducers" else ()


def load_builtin(section: SectionName, name: str) -> BaseModel:
    """Load a packaged document."""
    loader: Callable[[str], BaseModel] = load_profile if section == "profiles" else load_reducer
    return loader(name)
