"""Model files: a fitted model with its provenance, as JSON with a checksum."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torquebench.atomic_write import atomic_write
from torquebench.compensation.state import decode_value, encode_value
from torquebench.errors import InputError, ModelMismatchError
from torquebench.message import Message

if TYPE_CHECKING:
    from torquebench.compensation.base import CompensationModel

FORMAT = "torquebench-model"
FORMAT_VERSION = 1


@dataclass(frozen=True)
class ReadingScale:
    """Unit of the readings: another unit of torque, or one of a signal, force or mass.

    A reading times `nm_per_unit` plus `offset_nm` is a torque in N·m.

    Attributes
    ----------
    stated : str
        Sensitivity or lever arm, as a person stated it; empty for a torque, which needs none.

    Examples
    --------
    >>> scale = ReadingScale("mV/V", 250.0, 0.0, "2 mV/V at 500 N·m")
    >>> scale.text, ReadingScale.of_text(scale.text) == scale
    ('mV/V; 250.0; 0.0; 2 mV/V at 500 N·m', True)
    """

    unit: str
    nm_per_unit: float
    offset_nm: float = 0.0
    stated: str = ""

    def __str__(self) -> str:
        return self.unit

    @property
    def is_torque(self) -> bool:
        """Whether the readings are torques, so that any other unit of torque can replace theirs."""
        return not self.stated

    @property
    def formula(self) -> str:
        """Conversion to N·m as a formula.

        Examples
        --------
        >>> ReadingScale("kHz", 100.0, -1000.0, "10 kHz at 0 N·m; 15 kHz at 500 N·m").formula
        'N·m = 100 × kHz - 1000 (10 kHz at 0 N·m; 15 kHz at 500 N·m)'
        """
        zero = f" {'-' if self.offset_nm < 0 else '+'} {abs(self.offset_nm):.9g}"
        words = f"N·m = {self.nm_per_unit:.9g} × {self.unit}" + zero * bool(self.offset_nm)
        return words + f" ({self.stated})" * bool(self.stated)

    @property
    def text(self) -> str:
        """Unit and conversion as one text, which `of_text` reads."""
        return f"{self.unit}; {self.nm_per_unit!r}; {self.offset_nm!r}; {self.stated}"

    @classmethod
    def of_text(cls, text: str) -> ReadingScale:
        """Return the scale that a text states; `ValueError` if it states none."""
        unit, factor, offset, stated = (part.strip() for part in text.split(";", 3))
        return cls(unit, float(factor), float(offset), stated)


@dataclass(frozen=True)
class Provenance:
    """Origin of a model and its conditions of use.

    Attributes
    ----------
    range_nm : float
        Calibrated range in N·m.
    side : str
        "input", "output", or "" for a measuring chain outside a bench.
    transducer_serial : str
        Serial number of the transducer, "" when not known.
    counter_identity : str
        Timebase of the counter, "" if unknown.
    training_data_sha256 : str
        Hash of the calibration data.
    metrics : mapping of str to float
        Figures of the fit and of its cross-validation, names with their unit.
    software_version : str
        Version of torquebench that fitted the model.
    created : str
        Time of the fit, ISO 8601 with offset.
    calibrated_on : str
        Day of the calibration, ISO 8601; "" if unknown. The age of the calibration counts from this
        day, not from the day of the fit.
    unit : str
        Unit of readings and torques inside the model.
    reading_scale : str
        Unit of the calibration's readings, as `ReadingScale.text`; "" for N·m.
    effects : tuple of mapping
        Effects of the measuring chain, as stored by `torquebench.chain`.
    contradictions : tuple of str
        Contradictions within the calibration, or with this or the previous model; empty if it is
        plausible.
    accepted : str
        Who accepted the contradictions and why; "" if nobody did.
    """

    range_nm: float
    side: str = ""
    transducer_serial: str = ""
    counter_identity: str = ""
    training_data_sha256: str = ""
    metrics: Mapping[str, float] = field(default_factory=dict)
    software_version: str = ""
    created: str = ""
    calibrated_on: str = ""
    unit: str = "N·m"
    reading_scale: str = ""
    effects: tuple[Mapping[str, Any], ...] = ()
    contradictions: tuple[str, ...] = ()
    accepted: str = ""


@dataclass(frozen=True)
class StoredModel:
    """A fitted model with its provenance."""

    model: CompensationModel
    provenance: Provenance

    @property
    def scale(self) -> ReadingScale | None:
        """Unit of the calibration's readings; None for N·m."""
        text = self.provenance.reading_scale
        return ReadingScale.of_text(text) if text else None

    def check_fits(
        self,
        transducer_serial: str | None = None,
        counter_identity: str | None = None,
        range_nm: float | None = None,
    ) -> None:
        """Refuse another transducer, counter or range than those of the model.

        Parameters
        ----------
        transducer_serial, counter_identity : str, optional
            Serial number and identity on the bench; None skips the check.
        range_nm : float, optional
            Range that is to be measured in N·m; at most the calibrated one.

        Raises
        ------
        ModelMismatchError
            With the differences.
        """
        made_with = self.provenance
        for what, present, stored in (
            ("transducer", transducer_serial, made_with.transducer_serial),
            ("counter", counter_identity, made_with.counter_identity),
        ):
            if present is not None and present != stored:
                raise ModelMismatchError(
                    Message(
                        "model made with {what} {stored!r}, bench has {present!r}",
                        what,
                        stored or "unknown",
                        present,
                    ),
                    Message("the {what} that was calibrated", what),
                    Message("mount {what} {stored!r} or calibrate again", what, stored)
                    if stored
                    else "calibrate again",
                )
        if range_nm is not None and range_nm > made_with.range_nm * (1 + 1e-9):
            raise ModelMismatchError(
                Message(
                    "range {range_nm:g} N·m wanted, model calibrated to {made_with_range_nm:g} N·m",
                    range_nm,
                    made_with.range_nm,
                ),
                Message("up to {range_nm:g} N·m", made_with.range_nm),
                "calibrate over the whole range",
            )


def save_model(path: str | Path, stored: StoredModel, *, private: bool = False) -> Path:
    """Write a model file; the old file is kept until the new one is complete.

    Parameters
    ----------
    path : str or Path
        File to be written; an existing file is replaced.
    stored : StoredModel
        Fitted model with its provenance.
    private : bool
        Whether only its owner may read a new file.

    Raises
    ------
    InputError
        When the file can't be written.
    """
    target = Path(path)
    content = _content(stored)
    document = {**content, "checksum": _checksum(content)}
    text = json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    atomic_write(target, text.encode("utf-8"), private=private)
    return target


def load_model(path: str | Path) -> StoredModel:
    """Read a model file and rebuild the model bit for bit.

    Parameters
    ----------
    path : str or Path
        A file that `save_model` wrote.

    Raises
    ------
    InputError
        When there's no such file, it isn't a model file, its version or kind isn't known, or its
        content was changed after it was written.
    """
    source = Path(path)
    document = _read(source)
    content = {key: value for key, value in document.items() if key != "checksum"}
    if document.get("checksum") != _checksum(content):
        raise InputError(
            Message(
                "model file {source} was changed after it was written (checksum differs)", source
            ),
            "the file as torquebench wrote it",
            "restore the original or fit the model again",
        )
    names = {item.name for item in fields(Provenance)}

    from torquebench.compensation.factory import model_from_state

    try:
        provenance = Provenance(
            **{
                name: decode_value(value)
                for name, value in content["provenance"].items()
                if name in names
            }
        )
        model = model_from_state(content["model"])
    except (KeyError, TypeError, AttributeError) as problem:
        raise InputError(
            Message("model file {source} isn't complete ({problem})", source, problem),
            "a file as torquebench wrote it",
            "fit the model again",
        ) from problem
    return StoredModel(model, provenance)


def _read(source: Path) -> dict[str, Any]:
    """Read the JSON and check its format and version."""
    try:
        document = json.loads(source.read_text(encoding="utf-8"))
    except OSError as problem:
        raise InputError(
            Message("model file {source} can't be read ({strerror})", source, problem.strerror),
            remedy="check the path",
        ) from problem
    except ValueError as problem:
        raise InputError(
            Message("{source} isn't a model file ({problem})", source, problem),
            "JSON as torquebench writes it",
        ) from problem
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise InputError(
            Message("{source} isn't a model file", source),
            Message('JSON with "format": "{format}"', FORMAT),
        )
    if document.get("format_version") != FORMAT_VERSION:
        raise InputError(
            Message(
                "model file {source} of format version {document!r}",
                source,
                document.get("format_version"),
            ),
            Message("version {number}", FORMAT_VERSION),
            "use the version of torquebench that wrote it, or fit the model again",
        )
    return document


def _content(stored: StoredModel) -> dict[str, Any]:
    """Return a model file's content as plain values."""
    return {
        "format": FORMAT,
        "format_version": FORMAT_VERSION,
        "provenance": {
            item.name: encode_value(getattr(stored.provenance, item.name))
            for item in fields(Provenance)
        },
        "model": stored.model.get_state(),
    }


def _checksum(content: Mapping[str, Any]) -> str:
    """Return a hash of the content that is independent of layout and order of keys."""
    canonical = json.dumps(content, sort_keys=True, separators=(",", ":"), ensure_ascii=True)
    return hashlib.sha256(canonical.encode("ascii")).hexdigest()
