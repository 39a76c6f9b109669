"""Measurements of accuracy and speed, repeatable by seed; run as modules."""
