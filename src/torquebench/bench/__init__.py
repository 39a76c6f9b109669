"""The bench: its description, instruments, acquisition, devices, interlocks and supervisor.

Instruments have narrow interfaces (`drivers`); acquisition converts their edges to torque in a
thread of its own, and the supervisor checks every block, independently of procedures.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
