"""Files as people hand them in to the panel, evaluated in a process of their own."""

from pathlib import Path
from typing import Any

from torquebench.operations.static import StaticTable
from torquebench.panel.run_in_process import run_in_process
from torquebench.panel.service.files import FileStore, KnownNames
from torquebench.panel.service.jobs.runner import perform_on_files


def evaluated(content: bytes, name: str, **fields: Any) -> Any:
    """Hand in a table and evaluate it as the panel does."""
    store = FileStore()
    try:
        request = StaticTable(
            **{
                "table": Path(store.add(content, name)),
                "resolution_nm": 0.01,
                "reference_uncertainty": "0.02 of torque",
                **fields,
            }
        )
        return run_in_process(
            perform_on_files, "evaluate static", request, "", KnownNames({}), folder=store.folder
        )
    finally:
        store.close()
