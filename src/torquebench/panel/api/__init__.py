"""The panel's HTTP API under /api/v1, which offers the pages' operations to programs.

`create_api(service)` returns the application; its OpenAPI description is at
``/api/v1/openapi.json``, and `reference_page` shows it to people.
"""

from torquebench.panel.api.app import API_PATH, create_api
from torquebench.panel.api.reference import reference_page
from torquebench.panel.api.security import LARGEST_BODY, Guard

__all__ = ["API_PATH", "LARGEST_BODY", "Guard", "create_api", "reference_page"]
