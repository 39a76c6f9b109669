"""Operations: everything that a person or a program can request, each defined once.

An operation consists of a request, a preview, a function and the required role. The command, the
API's route, the job, the form, the documentation's page and the client's method are derived from
it. Operations work on an open bench, on records or on files (`Place`) and return a `Result`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
