"""The two source papers, item by item: measured, computed, and shown on one page.

All figures quoted from the papers are in `items`.
"""
