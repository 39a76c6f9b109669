"""What all tests share: reference data, isolation, and a watch on threads and tasks left behind."""

import atexit
import gc
import itertools
import logging
import os
import signal
import tempfile
import threading
import time
from collections.abc import Callable, Generator, Iterator
from pathlib import Path

# Before NumPy and Matplotlib are imported: one thread each, since tests run side by side.
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ["MPLBACKEND"] = "Agg"
# Benches in real time would take the processor from the tests beside them.
os.environ["TORQUEBENCH_PRIORITY"] = "usual"

import pytest
from hypothesis import HealthCheck, settings
from tests import postgresql_server

# A shell that starts the tests in the background has Ctrl-C ignored, and every process that a test
# starts would inherit that; the handler takes it back.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


# Workers share the process that commands come from.
if "PREPARED_COMMANDS" not in os.environ:
    _SHARED = tempfile.TemporaryDirectory(prefix="torquebench-")
    os.environ["PREPARED_COMMANDS"] = _SHARED.name
    atexit.register(_SHARED.cleanup)

# Programs that tests start use the plugins of this checkout, wherever they are installed from.
_SOURCES = [str(path) for path in Path(__file__).parent.glob("plugins/*/src")]
_BEFORE = os.environ.get("PYTHONPATH")
os.environ["PYTHONPATH"] = os.pathsep.join([*_SOURCES, *([_BEFORE] if _BEFORE else [])])

_CI = bool(os.environ.get("CI"))
_REPOSITORY = Path(__file__).resolve().parent
_REFERENCE_DATA = Path(
    os.environ.get("TORQUEBENCH_REFERENCE_DATA", _REPOSITORY.parent / "shared" / "data")
)

for _profile, _examples in (("torquebench", 5), ("nightly", 300)):
    settings.register_profile(
        _profile,
        deadline=None,
        derandomize=_CI and _profile == "torquebench",
        max_examples=_examples,
        suppress_health_check=[HealthCheck.too_slow],
    )
settings.load_profile("torquebench")


_LONG = (
    "test_panel_calibration.py",
    "test_http_api_schema.py",
    "test_interfaces.py",
    "test_panel_bench.py",
    "test_reducer_tests_again_postgresql.py",
    "test_documentation_bench.py",
    "test_driver_contract.py",
)
"""With long tests or many that wait: begun last, they would leave the other processor idle."""


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """By day don't import what runs at night."""
    return (
        True
        if collection_path == _REPOSITORY / "tests" / "nightly"
        and "not nightly" in config.option.markexpr
        else None
    )


@pytest.hookimpl(wrapper=True)
def pytest_collect_file(
    file_path: Path,
) -> Generator[None, list[pytest.Collector], list[pytest.Collector]]:
    """Look for examples in sources alone: tests would be imported and searched twice."""
    collectors = yield
    return [each for each in collectors if "src" in file_path.parts or type(each) is pytest.Module]


def pytest_collection_finish() -> None:
    """Let no collection of garbage look again at a million objects of modules and tests."""
    gc.collect()
    gc.freeze()


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Begin with the longest; leave out what needs data that a clone lacks."""
    items.sort(key=lambda item: item.path.name not in _LONG)
    if _CI or _REFERENCE_DATA.is_dir():
        return
    left_out = [item for item in items if "reference_data" in getattr(item, "fixturenames", ())]
    if left_out:
        items[:] = [item for item in items if item not in left_out]
        config.hook.pytest_deselected(items=left_out)


def pytest_report_header() -> list[str]:
    """Say in a line each which tests are left out, and how to run them."""
    lines = []
    if not (_CI or _REFERENCE_DATA.is_dir()):
        lines.append(
            f"reference tests are left out: no folder {_REFERENCE_DATA} "
            "(give it by TORQUEBENCH_REFERENCE_DATA)"
        )
    if not (_CI or postgresql_server.binaries()):
        lines.append(
            "the registry isn't tested on PostgreSQL: no server is installed "
            "(Debian package: postgresql)"
        )
    return lines


@pytest.fixture(scope="session")
def reference_data() -> Callable[[str], Path]:
    """Return a function from a name below the reference data to its path."""

    def path(name: str) -> Path:
        found = _REFERENCE_DATA / name
        assert found.exists(), f"reference data {found} is missing"
        return found

    return path


@pytest.fixture
def curve_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Fit forms as to few points, without a posterior: most of a fit, where U isn't looked at."""
    monkeypatch.setattr("torquebench.compensation.base.FEWEST_POINTS", 1_000_000)


@pytest.fixture(scope="session", autouse=True)
def _remembered_schema() -> None:
    from tests.support.repeated import remember_schema

    remember_schema()


@pytest.fixture(autouse=True)
def _remembered_fits(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Fit the same points once, except where fits are what is tested."""
    if "compensation" not in request.path.parts:
        from tests.support.repeated import HybridModel, remembered_average

        monkeypatch.setattr(HybridModel, "_averaged", remembered_average)


_numbers = itertools.count()


@pytest.fixture(autouse=True)
def _isolated_data_directory(
    tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path_factory.getbasetemp() / f"torquebench-data-{next(_numbers)}"
    monkeypatch.setenv("TORQUEBENCH_DATA", str(folder))


class _AsyncioComplaints(logging.Handler):
    """Collects what asyncio has to say about tasks that nobody awaited or ended."""

    def __init__(self) -> None:
        super().__init__(logging.ERROR)
        self.messages: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.messages.append(record.getMessage())


IDLE_TIMER = "torquebench-idle"
"""It outlives a computation on purpose: the server of forks ends when it has been idle."""


@pytest.fixture(autouse=True)
def _nothing_left_behind() -> Iterator[None]:
    before = set(threading.enumerate())
    complaints = _AsyncioComplaints()
    logger = logging.getLogger("asyncio")
    logger.addHandler(complaints)
    yield
    logger.removeHandler(complaints)
    deadline = time.monotonic() + 60.0
    while leaked := [
        thread
        for thread in threading.enumerate()
        if thread not in before and thread.name != IDLE_TIMER
    ]:
        if time.monotonic() > deadline:
            pytest.fail(f"threads left behind: {', '.join(thread.name for thread in leaked)}")
        leaked[0].join(0.05)
    if complaints.messages:
        pytest.fail("asyncio complains: " + "; ".join(complaints.messages))
