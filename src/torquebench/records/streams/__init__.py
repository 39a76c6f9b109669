"""Append-only Arrow streams that survive a kill at any moment: raw samples and readings."""
