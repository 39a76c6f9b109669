"""Tables of tests, from texts and files."""

import io

from torquebench.calibration import CalibrationData
from torquebench.tables import calibration_of
from torquebench.tables.formats.text import TextFile


def parse_calibration(
    text: str, origin: str = "a table", *, range_nm: float | None = None
) -> CalibrationData:
    content = text.encode()
    table = TextFile(origin, io.BytesIO(content), len(content)).whole()
    return calibration_of(table, range_nm, False, ("", "", "")).data
