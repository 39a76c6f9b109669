"""Certificates of calibrations: a record, and written from it a PDF per language and an XML file.

`build_record` collects the data of a registered calibration, `issue_certificate` writes and
registers the files, and `check_certificate` verifies a file.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
