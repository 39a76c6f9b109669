"""Modbus: link, register map, and the modules of a bench."""
