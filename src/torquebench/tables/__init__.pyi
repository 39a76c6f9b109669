from .compensating import (
    CompensatedFile as CompensatedFile,
    compensate_file as compensate_file,
)
from .conversion import (
    Conversion as Conversion,
    Sensitivity as Sensitivity,
)
from .dcc import (
    DccQuantity as DccQuantity,
    DigitalCertificate as DigitalCertificate,
    is_dcc as is_dcc,
    parse_dcc as parse_dcc,
    read_dcc as read_dcc,
)
from .formats import (
    check_kept as check_kept,
    check_read as check_read,
    check_written as check_written,
    endings as endings,
    reads as reads,
    write_table as write_table,
)
from .formats.text import (
    decode_text as decode_text,
    remarks_in as remarks_in,
)
from .headers import (
    LABEL as LABEL,
    WORD as WORD,
    Understood as Understood,
    understand as understand,
)
from .isolated import (
    Limits as Limits,
)
from .reading import (
    LIMITS as LIMITS,
    open_table as open_table,
    read_table as read_table,
    table_of_arrow as table_of_arrow,
    table_text as table_text,
)
from .readings import (
    ADDED_COLUMNS as ADDED_COLUMNS,
    READING_COLUMNS as READING_COLUMNS,
    CalibrationTable as CalibrationTable,
    ReadingsTable as ReadingsTable,
    TableColumns as TableColumns,
    calibration_csv as calibration_csv,
    calibration_of as calibration_of,
    check_model as check_model,
    maps_one as maps_one,
    model_conversion as model_conversion,
    read_calibration as read_calibration,
    read_calibration_table as read_calibration_table,
    read_empty_run as read_empty_run,
    read_readings as read_readings,
    write_calibration as write_calibration,
)
from .remarks import (
    UNCERTAINTY as UNCERTAINTY,
    reference_remarks as reference_remarks,
)
from .table import (
    Table as Table,
    numbers_of as numbers_of,
)
