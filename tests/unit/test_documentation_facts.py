"""What the documentation says about the program is so: options, profiles, figures, version."""

import re
import tomllib
from pathlib import Path
from typing import Any

import pytest

from torquebench import __version__
from torquebench.bench import channels
from torquebench.bench.clock import LARGEST_DRIFT
from torquebench.bench.description import SafetyDescription
from torquebench.bench.drivers import base as drivers
from torquebench.bench.safety import following, priority, stopping, supervisor
from torquebench.campaign.reducers import sampling
from torquebench.campaign.reducers.uncertainty import UNCOMPENSATED_SHARE
from torquebench.cli import whole_command
from torquebench.dynamics.design import GAIN_OF_BANDWIDTH
from torquebench.panel import connections, run_in_process
from torquebench.panel.api import security, stream
from torquebench.panel.service import files
from torquebench.panel.service.access import lease, login_throttle, sessions
from torquebench.panel.service.live import hub
from torquebench.panel.service.settings import documents, store
from torquebench.procedures import guarding
from torquebench.procedures.reducers.running import EfficiencySettings
from torquebench.reducers.running.tare import TRANSFER_SHARE
from torquebench.station import engine, recording

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = [
    page
    for page in (ROOT / "README.md", *DOCS.rglob("*.md"), *ROOT.glob("plugins/*/docs/*.md"))
    if not {"_build", "generated"} & set(page.parts)
]
READ = [page for page in PAGES if "decisions" not in page.parts]
OF_ALL = {"--json", "--quiet", "--debug", "--version", "--registry", "--help"}


def text(page: Path) -> str:
    return page.read_text(encoding="utf-8")


def command_options() -> dict[str, set[str]]:
    found: dict[str, set[str]] = {}

    def walk(command: Any, path: str) -> None:
        for name, child in getattr(command, "commands", {}).items():
            walk(child, f"{path} {name}".strip())
        if not hasattr(command, "commands"):
            found[path] = {o for p in command.params for o in (*p.opts, *p.secondary_opts)}

    walk(whole_command(), "")
    return found


def test_the_reference_gives_a_command_only_options_that_it_has() -> None:
    known = command_options()
    wrong = []
    for line in text(DOCS / "reference" / "commands.md").splitlines():
        cells = re.match(r"\| (`.*?) \| (.*) \|$", line)
        if not cells:
            continue
        named = [
            each
            for each in known
            for code in re.findall(r"`([^`]+)`", cells[1])
            if re.match(rf"{each.split()[0]}\b", code) and set(each.split()) <= _words(cells[1])
        ]
        allowed = OF_ALL.union(*(known[each] for each in named)) if named else None
        options = re.findall(r"`(--[a-z][a-z-]+)", f"{cells[1]} {cells[2]}")
        if allowed is not None:
            wrong += [f"{named}: {each}" for each in options if each not in allowed]
    assert wrong == []


def _words(cell: str) -> set[str]:
    return {
        word
        for code in re.findall(r"`([^`]+)`", cell)
        for part in code.split()
        for word in re.split(r"[\\|]+", part)
    }


def test_benchmarks_in_the_documentation_have_the_options_that_they_are_given() -> None:
    command = re.compile(r"`python -m benchmarks[. ](\w+)((?: [^`]*)?)`")
    wrong = []
    for page in READ:
        for module, options in command.findall(text(page)):
            path = ROOT / "benchmarks" / f"{module}.py"
            assert path.is_file(), f"{page.name}: {module}"
            given = re.findall(r"--[a-z-]+", options)
            wrong += [f"{page.name}: {module} {each}" for each in given if each not in text(path)]
    assert wrong == []


def test_the_page_of_benchmarks_is_short() -> None:
    lines = text(DOCS / "benchmarks.md").splitlines()
    prose = [line for line in lines if not line.startswith(("|", "#", "<!--", "!["))]
    assert len(" ".join(prose).split()) <= 1500


def test_the_architecture_is_short_and_names_what_there_is() -> None:
    page = text(DOCS / "architecture.md")
    assert len(page.split()) <= 1500
    package = ROOT / "src" / "torquebench"
    paths = [name for name in re.findall(r"`([\w/]+(?:\.py|\.toml|/))`", page) if "NEW" not in name]
    there = {str(path.relative_to(package)) for path in package.rglob("*")}
    tails = {path.rsplit("/", 1)[-1] for path in there}
    lost = [
        name
        for name in paths
        if name.rstrip("/") not in there | tails and not (ROOT / name).exists()
    ]
    assert lost == []
    modules = {
        path.name + ("/" if path.is_dir() else "")
        for path in package.iterdir()
        if path.suffix == ".py" or (path / "__init__.py").is_file()
    }
    unnamed = {"__init__.py", "__main__.py", *re.findall(r"[\w]+(?:\.py|/)", page)}
    assert modules - unnamed == set()


def test_coverage_of_drifting_chains_is_stated_in_one_place() -> None:
    families = re.compile(r"\*(?:warming|creeping)\*[^|]{0,40}\d+ %")
    assert [page.name for page in READ if families.search(text(page))] == ["benchmarks.md"]


def test_packaged_profiles_are_all_named() -> None:
    packaged = {
        each.stem for each in (ROOT / "src/torquebench/calibration/profiles").glob("*.toml")
    }
    page = text(DOCS / "how-to" / "evaluate-an-external-calibration.md")
    assert {name for name in packaged if f"`{name}`" not in page} == set()


def test_every_picture_is_shown_and_screenshots_have_both_looks() -> None:
    shown = {name for page in PAGES for name in re.findall(r"images/([\w/.-]+)", text(page))}
    there = {str(path.relative_to(DOCS / "images")) for path in (DOCS / "images").rglob("*.*")}
    assert shown == there
    light = {name for name in there if name.startswith("panel/") and "-dark" not in name}
    assert {name.replace(".png", "-dark.png") for name in light} <= there


def test_the_version_stands_in_one_place_and_citation_and_changes_follow_it() -> None:
    project = tomllib.loads(text(ROOT / "pyproject.toml"))
    assert "version" in project["project"]["dynamic"]
    assert project["tool"]["hatch"]["version"]["path"] == "src/torquebench/__init__.py"
    cited = re.search(r"^version: (\S+)$", text(ROOT / "CITATION.cff"), re.M)
    newest = re.search(r"^## (\d+\.\d+\.\d+) - \d{4}-", text(ROOT / "CHANGELOG.md"), re.M)
    assert cited is not None
    assert newest is not None
    assert {cited[1], newest[1]} == {__version__}


KIB = 1024
SAFETY = SafetyDescription.model_fields
FIGURES = {
    "explanation/panel-security.md": (
        f"After five wrong passwords for one person from one address, or "
        f"{login_throttle.PER_ADDRESS} from one address, within "
        f"{login_throttle.WINDOW_S / 60:.0f} minutes",
        f"by {login_throttle.FIRST_PAUSE_S:.0f} s, then twice as long",
        "after an hour without activity, after twelve hours at the latest",
        "nothing for two minutes while nothing runs",
        f"Limits are {security.LARGEST_BODY // KIB**2} MiB for a body, "
        f"{documents.LARGEST_UPLOAD // KIB} KiB for an uploaded profile and "
        f"{files.LARGEST_FILE // KIB} KiB for a file of an operation",
        f"has {run_in_process.MOST_MB} MB of address space, {run_in_process.MOST_S / 60:.0f} "
        f"minutes of processor time and a result of {run_in_process.MOST_RESULT_MB} MB at most",
        "Documents deeper than twelve levels",
        f"Limits for a request are {connections.HEAD_S:.0f} s and "
        f"{connections.LARGEST_HEAD // KIB} KiB for its head, and {security.BODY_S:.0f} s for its",
        f"reads nothing for {stream.SLOWEST_S:.0f} s",
    ),
    "explanation/safety.md": (
        f"changes by {channels.MOVED_SHARE:.0%} of its".replace("%", " %"),
        f"within {drivers.CLOCKS_APART_S:g} s and two of its periods",
        f"for {following.DEVIATING_S:g} s and two blocks",
        f"read every {supervisor.WATCH_PERIOD_S * 1000:.0f} ms in real time",
        f"doesn't answer for {engine.LOOP_TIMEOUT_S:.0f} s",
        f"the ramp and {stopping.UNLOAD_SETTLING_S:g} s of settling",
        f"If that isn't so {stopping.GOING_OFF_S:.0f} s after the time of watchdog and ramp",
        f"Deviations below `following_percent` ({SAFETY['following_percent'].default:.0f} %)",
        f"allows {guarding.TORQUE_MARGIN * 100:.0f} % of its largest torque (plus "
        f"{guarding.ZERO_MARGIN * 100:.0f} % of the range before the zero is measured), "
        f"{guarding.STANDING_RPM:.0f} rpm, {guarding.STANDING_DEG:.0f}°",
        f"slices of `fast_check_s` ({SAFETY['fast_check_s'].default * 1000:.0f} ms)",
        f"nice    {priority.NICENESS}",
        f"switches every {priority.SWITCH_INTERVAL_S * 1000:g} ms",
    ),
    "how-to/use-the-panel.md": (
        f"The newest {hub.ROWS * 0.03:.0f} s are kept with every block",
        f"the newest {hub.ROWS * 0.3 / 60:.0f} min in rows of 0.3 s",
        f"It can include up to {recording.LONGEST_BEFORE_S:.0f} s before the start",
    ),
    "how-to/measure-quick-torques.md": (f"by default {GAIN_OF_BANDWIDTH:g} times the chain's",),
    "how-to/test-a-reducer.md": (
        f"at most {EfficiencySettings.most_repeats} times",
        f"{sampling.POSITION_SHARE * 100:.0f} % of the value for differences between output "
        "positions if fewer than three were measured",
        f"{sampling.WARMING_SHARE * 100:.0f} % for friction that decreases",
        f"contains its scatter and {TRANSFER_SHARE * 100:.0f} % of the drag",
        f"the uncertainty is {UNCOMPENSATED_SHARE * 100:g} % of full scale",
    ),
    "reference/device-protocols.md": (
        f"agree with the counter's within {LARGEST_DRIFT * 100:g} %",
    ),
}


@pytest.mark.parametrize("page", FIGURES)
def test_figures_of_the_documentation_are_those_of_the_code(page: str) -> None:
    words = " ".join(text(DOCS / page).split())
    assert [figure for figure in FIGURES[page] if " ".join(figure.split()) not in words] == []


def test_figures_that_the_documentation_spells_out_are_those_of_the_code() -> None:
    assert login_throttle.PER_PERSON_AND_ADDRESS == 5
    assert (sessions.IDLE_S, sessions.LONGEST_S, lease.IDLE_S) == (3600.0, 12 * 3600.0, 120.0)
    assert (store.DEEPEST, sampling.LEAST_POSITIONS) == (12, 3)
    assert guarding.RATE_MARGIN == 4.0
