"""The Python interface of notebooks and scripts: a few functions, data frames in and out.

Its names are those of `torquebench` itself: ``import torquebench as tb``.
"""
