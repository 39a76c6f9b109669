"""Contract suites for operations and drivers of one's own, for pytest.

Subclass `operations.OperationContract`, `drivers.DriverContract` or `drives.DriveContract` in a
test file and state what is to be tested: each test of the class then runs. They need the extra
`testing`.
"""

import pytest

pytest.register_assert_rewrite(
    *(f"torquebench.testing.{name}" for name in ("drivers", "drives", "operations"))
)
