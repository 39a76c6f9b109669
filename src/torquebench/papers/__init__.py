"""Reproduce the two source papers, item by item, on one page of measured and computed results.

All figures quoted from the papers are in `items`.
"""
