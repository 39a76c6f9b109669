"""The PDF of a certificate, typeset by Typst; the same record gives the same bytes."""

from __future__ import annotations

import io
from datetime import UTC, datetime, time
from importlib import resources
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import segno

from torquebench.errors import InputError
from torquebench.figures import Curve, error_figure
from torquebench.message import Message
from torquebench.reports.certificate.content import certificate_content
from torquebench.reports.certificate.labels import labels_of
from torquebench.reports.certificate.record import CertificateRecord
from torquebench.reports.certificate.setting import typeset

if TYPE_CHECKING:
    import typst

PDF_STANDARD: Final = "a-2u"
"""PDF/A for archives: embedded fonts, searchable text."""
PICTURE_PPI: Final = 110.0
"""Resolution of pages as pictures, pixels per inch."""


def certificate_pdf(
    record: CertificateRecord, language: str, installed: typst.Fonts | None = None
) -> bytes:
    """Return the PDF of a certificate.

    Parameters
    ----------
    record : CertificateRecord
    language : str
        ``"en"``, ``"de"`` or ``"zh"``.
    installed : typst.Fonts, optional
        Fonts among which a Chinese one is chosen; by default the system's.

    Returns
    -------
    bytes
        PDF/A-2u. It contains the record's dates only, so that the same record gives the same bytes
        with the same versions of torquebench, Typst and Matplotlib.

    Raises
    ------
    InputError
        Where the language or a font for the text is missing.
    """
    return _typeset(record, language, installed, format="pdf", pdf_standards=[PDF_STANDARD])[0]


def certificate_pages(record: CertificateRecord, language: str) -> list[bytes]:
    """Return the pages of a certificate as PNG for a preview; raises like `certificate_pdf`."""
    return _typeset(record, language, None, format="png", ppi=PICTURE_PPI)


def _typeset(
    record: CertificateRecord, language: str, installed: typst.Fonts | None, **kind: Any
) -> list[bytes]:
    import typst  # late: 7 MB that only certificates need

    template = resources.files(__package__) / "certificate.typ"
    figures: dict[str, str | bytes] = {
        "errors.svg": errors_svg(record, language),
        "code.svg": code_svg(record),
    }
    content = certificate_content(record, language)
    issued = datetime.combine(record.issued, time(), UTC)
    try:
        return typeset(template, content, figures, installed, timestamp=issued, **kind)
    except typst.TypstError as error:
        raise InputError(
            Message("the certificate can't be typeset: {error}", error),
            remedy="report the record with this text",
        ) from error


def code_svg(record: CertificateRecord) -> bytes:
    """Return the QR code of the certificate's payload as SVG."""
    buffer = io.BytesIO()
    code = segno.make(record.payload, error="m", micro=False)
    code.save(buffer, kind="svg", border=2, omitsize=True)
    return buffer.getvalue()


def errors_svg(record: CertificateRecord, language: str) -> str:
    """Draw the errors before and after compensation as SVG."""
    words = labels_of(language)
    torque = np.array([row.torque_nm for row in record.results])
    before = np.array([row.error_before_nm for row in record.results])
    # The figure's font has no Chinese characters.
    names = ("①", "②") if language == "zh" else (words["before"], words["after"])
    name = names[0] if record.compensation or language == "zh" else words["error"]
    curves = [Curve(name, torque, before, raw=True)]
    if record.compensation:
        after = np.array([row.error_after_nm for row in record.results], dtype=np.float64)
        curves.append(Curve(names[1], torque, after))
    conformity = record.conformity
    return error_figure(
        curves,
        record.item.range_nm,
        limit_fs=None if conformity is None else conformity.tolerance_percent_fs / 100.0,
        abscissa=words["figure_torque"],
        ordinate=words["figure_error"],
        side=record.item.side,
    )
