"""Tests of a mounted reducer and their results."""
