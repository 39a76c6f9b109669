"""The tables of the plant's benchmark stand between markers of the document, part by part."""

import subprocess
import sys
from pathlib import Path

from benchmarks.reporting import write_section
from plugins.plant.benchmark import (
    day_section,
    drift_section,
    growth_section,
    lists_section,
    refits_section,
)

ROWS = [
    {
        "runs": runs,
        "newest_100_ms": 24.4,
        "withdraw_ms": 17.0,
        "entries_a_second": 2800.0,
        "size_gb": 0.3,
        "memory_mb": 310.2,
        "files": runs // 100,
        "drift_s": 1.93,
    }
    for runs in (10_000, 100_000, 1_000_000)
]
DAY = {"benches": 3, "runs": 432, "refused": 9, "seconds": 22.0, "lost": 0, "twice": 0}
REFITS = {
    "calibrations": 1000,
    "a_second_1": 12.0,
    "a_second_2": 22.1,
    "ratio": 1.84,
    "memory_mb": [[300, 309], [500, 515]],
    "different": 0,
}


def test_each_part_replaces_its_own_section_of_the_page(tmp_path: Path) -> None:
    page = tmp_path / "benchmarks.md"
    before = "# Benchmarks\n\n<!-- other: begin -->\nkept\n<!-- other: end -->\n"
    page.write_text(before, encoding="utf-8")
    for name, text, said in (
        ("lists", lists_section(ROWS), "of 300, ms | 24 | 24 | 24 | ≤ 50 |"),
        (
            "growth",
            growth_section(ROWS),
            "sending, entries a second | 2,800 | 2,800 | 2,800 | – |",
        ),
        ("drift", drift_section(ROWS), "over 10,000 Parquet files (81 points each): 1.9 s"),
        ("day", day_section(DAY), "0 were lost and 0 duplicated"),
        ("refits", refits_section(REFITS), "(1.84 times; aim 1.8)"),
    ):
        for _ in range(2):
            write_section(page, f"plant-{name}", text)
        assert said in page.read_text(encoding="utf-8")
    after = page.read_text(encoding="utf-8")
    head = "\n| | 10,000 runs | 100,000 | 1,000,000 | aim |\n| --- | --- | --- | --- | --- |\n"
    assert after.count(head) == 2
    assert after.startswith(before)
    assert after.count("<!--") == 2 * 6


def test_a_quick_fleet_is_not_written() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "plugins.plant.benchmark", "--quick", "--write"],
        cwd=Path(__file__).parents[3],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert "the tables are those of the whole fleet" in done.stderr
