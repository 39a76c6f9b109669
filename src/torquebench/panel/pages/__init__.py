"""The pages that a person at the bench sees: live, calibrate, tests, records, settings, alarms.

`register_pages(service)` adds them to NiceGUI's application; they talk to the panel's service only.
"""

from torquebench.panel.pages.register import register_pages

__all__ = ["register_pages"]
