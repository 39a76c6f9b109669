"""Reports: figures, and the self-contained HTML pages that show them.

A figure function takes arrays and returns an SVG string; a page function takes results
and writes one file that needs no network to open.
"""
