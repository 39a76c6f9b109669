"""The Python interface for notebooks and scripts: a few functions, data frames in and out.

Its names are those of `torquebench` itself: ``import torquebench as tb``.
"""
