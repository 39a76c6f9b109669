"""The panel's pages, which register themselves by `page` and use only the panel's service.

`register_pages(service)` adds them to NiceGUI's application. A new page is one module here with the
Chinese of its texts in `translations/zh/`.
"""

from torquebench.panel.pages.page import PAGES
from torquebench.panel.pages.register import import_pages, register_pages

__all__ = ["PAGES", "register_pages"]

import_pages()
