"""Make every picture of the documentation again: `make pictures`, about three minutes.

`python -m tests.pictures drawings`, `charts`, `demo` or `panel` makes a part of them; the variable
PICTURES names another folder for them.
"""

import os
import sys
import tempfile
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")  # before NumPy is imported, as the command does
from tests.pictures import charts, demo, drawings, panel

IMAGES = Path(os.environ.get("PICTURES", Path(__file__).parents[2] / "docs" / "images"))
PARTS = {"drawings": drawings.make, "charts": charts.make, "demo": demo.make, "panel": panel.make}

with tempfile.TemporaryDirectory(prefix="torquebench-pictures-") as commands:
    os.environ.setdefault("PREPARED_COMMANDS", commands)
    for name in sys.argv[1:] or PARTS:
        with tempfile.TemporaryDirectory(prefix="torquebench-pictures-") as scratch:
            for written in PARTS[name](IMAGES, Path(scratch)):
                print(written.relative_to(IMAGES.parent))
