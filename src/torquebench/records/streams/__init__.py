"""Append-only Arrow streams of raw samples and readings that survive a kill at any time."""
