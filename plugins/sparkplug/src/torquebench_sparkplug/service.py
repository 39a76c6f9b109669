"""The option `--sparkplug` of `torquebench panel`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from torquebench.panel.beside import PanelService, ServedBench

if TYPE_CHECKING:
    from torquebench_sparkplug.settings import SparkplugSettings

__all__ = ["SERVICE"]


def _settings(value: str) -> SparkplugSettings:
    from torquebench_sparkplug.settings import load_settings

    return load_settings(Path(value))


@contextmanager
def _serve(
    bench: ServedBench, settings: SparkplugSettings, note: Callable[[str], None]
) -> Iterator[None]:
    from torquebench_sparkplug.publisher import Publisher

    with Publisher.of(bench, settings, lambda text: note(f"Sparkplug: {text}")):
        yield


SERVICE = PanelService(
    option="sparkplug",
    value="FILE",
    help="Publish the bench by MQTT Sparkplug B, as this settings file (.toml) says.",
    settings=_settings,
    serve=_serve,
)
