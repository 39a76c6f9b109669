"""The HTTP API of the panel, under /api/v1: the same operations as the pages, for programs.

`create_api(service)` returns the application; its OpenAPI description is at
``/api/v1/openapi.json``.
"""

from torquebench.panel.api.app import API_PATH, create_api
from torquebench.panel.api.security import LARGEST_BODY, Guard

__all__ = ["API_PATH", "LARGEST_BODY", "Guard", "create_api"]
