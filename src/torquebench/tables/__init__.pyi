from .csv_text import (
    decode_csv as decode_csv,
)
from .readings import (
    ReadingsTable as ReadingsTable,
    calibration_csv as calibration_csv,
    parse_calibration as parse_calibration,
    read_calibration as read_calibration,
    read_empty_run as read_empty_run,
    read_readings as read_readings,
    write_calibration as write_calibration,
)
