"""Devices written from docs/reference/device-protocols.md alone, one a protocol, in real time.

They know nothing of torquebench: no simulator, no twin, no register map of its drivers.
"""
