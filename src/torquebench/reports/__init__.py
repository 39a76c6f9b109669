"""Reports: figures, and the self-contained HTML pages that show them.

A figure function takes arrays and returns SVG text; a page function takes results and returns a
`Page`, which is written as one file that needs no network.
"""
