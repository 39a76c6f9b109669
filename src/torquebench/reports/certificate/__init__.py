"""Certificates of calibrations: one record, and from it a PDF per language and a digital XML.

`build_record` gathers what a calibration in the registry allows to state, `issue_certificate`
writes and registers the files, and `check_certificate` tells whether a file is one of them.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
