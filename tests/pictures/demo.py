"""The demo in a terminal, as an SVG that moves."""

import subprocess
import time
from collections.abc import Iterator
from html import escape
from pathlib import Path

from tests.system.command_line import COMMAND, environment

COLUMNS, ROWS, CHARACTER, LINE = 80, 26, 8.4, 17
LONGEST_PAUSE_S, SHOWN_AT_THE_END_S = 1.2, 6.0
STYLE = """
  .screen { fill: #ffffff; stroke: #d0d7de } text { fill: #1f2328 } .prompt { fill: #0969da }
  @media (prefers-color-scheme: dark) {
    .screen { fill: #0d1117; stroke: #30363d } text { fill: #e6edf3 } .prompt { fill: #58a6ff }
  }
  text { font: 14px ui-monospace, SFMono-Regular, Menlo, Consolas, monospace; white-space: pre }
"""


def make(images: Path, scratch: Path) -> Iterator[Path]:
    """Record `torquebench demo --quick` and draw it."""
    path = images / "demo.svg"
    path.write_text(animated(recorded(scratch)), encoding="utf-8")
    yield path


def recorded(folder: Path) -> list[tuple[float, str]]:
    """Run the demo; return its lines with the times at which they came, pauses cut short."""
    lines = [(0.0, "$ torquebench demo --quick")]
    before, shown = time.monotonic(), 0.6
    with subprocess.Popen(
        [COMMAND, "demo", "--quick"],
        cwd=folder,
        env=environment(),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as process:
        assert process.stdout is not None
        for line in process.stdout:
            now = time.monotonic()
            shown += min(max(now - before, 0.04), LONGEST_PAUSE_S)
            before = now
            lines.append((shown, line.rstrip()))
    assert process.returncode == 0, lines
    return lines


def animated(lines: list[tuple[float, str]]) -> str:
    """Return lines that appear one after the other, and scroll where the screen ends."""
    total = lines[-1][0] + SHOWN_AT_THE_END_S
    width, height = COLUMNS * CHARACTER + 24, ROWS * LINE + 24
    steps = [
        (at / total, -LINE * max(0, number + 1 - ROWS)) for number, (at, _) in enumerate(lines)
    ]
    values = ";".join(f"0 {up}" for _, up in steps)
    times = ";".join(f"{share:.4f}" for share, _ in steps)
    rows = []
    for number, (at, text) in enumerate(lines):
        share = at / total
        hidden = (
            f'<animate attributeName="visibility" dur="{total:.2f}s" repeatCount="indefinite" '
            f'calcMode="discrete" values="hidden;visible" keyTimes="0;{share:.4f}"/>'
            if share > 0
            else ""
        )
        kind = ' class="prompt"' if number == 0 else ""
        rows.append(
            f'<text x="12" y="{12 + LINE * (number + 0.8):.1f}"{kind}>{escape(text)}{hidden}</text>'
        )
    body = "\n".join(rows)
    view = f'viewBox="0 0 {width:.0f} {height}" role="img"'
    return f"""<svg xmlns="http://www.w3.org/2000/svg" {view}>
<title>torquebench demo --quick in a terminal (simulated)</title>
<style>{STYLE}</style>
<rect class="screen" x="0.5" y="0.5" width="{width - 1:.0f}" height="{height - 1}" rx="6"/>
<svg x="0" y="8" width="{width:.0f}" height="{height - 16}">
<g><animateTransform attributeName="transform" type="translate" dur="{total:.2f}s" \
repeatCount="indefinite" calcMode="discrete" values="{values}" keyTimes="{times}"/>
{body}
</g></svg></svg>
"""
