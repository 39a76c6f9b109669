"""The bench: its description, instruments, acquisition, devices, interlocks and supervisor.

Instruments sit behind narrow roles (`drivers`); acquisition turns their edges into torque in a
thread of its own, and the supervisor judges every block below any procedure.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
