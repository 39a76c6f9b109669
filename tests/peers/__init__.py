"""Devices written from docs/reference/device-protocols.md alone, one a protocol, in real time.

They know nothing of torquebench but the faults of its contract suites: no simulator, no twin, no
register map of its drivers.
"""
