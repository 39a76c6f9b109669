"""The two source papers, item by item: measured, computed, and set on one page.

What is shown as the papers' own is stated in `items` and nowhere else.
"""
