"""The pages of the panel: live, calibrate, tests, records, settings, alarms.

`register_pages(service)` adds them to NiceGUI's application; they use the panel's service only.
"""

from torquebench.panel.pages.register import PAGES, register_pages

__all__ = ["PAGES", "register_pages"]
