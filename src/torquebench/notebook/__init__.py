"""The Python interface for notebooks and scripts, which works with data frames.

Its functions are imported from `torquebench`: ``import torquebench as tb``.
"""
