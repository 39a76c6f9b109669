"""Reports in a browser: nothing is cut off at the widths of screens."""

import re
import subprocess
from pathlib import Path

import pytest
from tests.programs import program
from tests.support.draws import nightly

from torquebench.reports.page import Page, Section, Table, render_page

MEASURE = """<script>
const parts = [...document.querySelectorAll(".scroll, main")];
document.title = "beyond " + Math.max(...parts.map(e => e.scrollWidth - e.clientWidth));
</script>"""


@pytest.mark.parametrize("width", [800, nightly(1100)])
def test_the_comparison_of_models_stays_on_the_page(width: int, tmp_path: Path) -> None:
    errors = ("worst, N·m", "RMS, N·m", "worst, % FS", "RMS, % FS", "worst step mean, N·m")
    verdict = "3.5 standard errors worse than hybrid"
    row = ("bayesian-network", "17.6", "7.03", "0.0878", "0.0352", "0.896", "19.5", verdict)
    table = Table(("model", *errors, "parameters", "verdict"), [row] * 3, emphasised=1)
    page = tmp_path / "page.html"
    page.write_text(render_page(Page("Fit", "", [Section("Models", "", (table,))])) + MEASURE)
    browser = program("chromium")
    assert browser is not None
    options = ("--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path}/p")
    shown = subprocess.run(
        [browser, *options, f"--window-size={width},900", "--dump-dom", page.as_uri()],
        capture_output=True,
        text=True,
        check=True,
        timeout=240,
    )
    beyond = re.search(r"<title>beyond (-?\d+)", shown.stdout)
    assert beyond is not None
    assert int(beyond[1]) <= 0
