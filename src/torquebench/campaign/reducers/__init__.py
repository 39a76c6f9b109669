"""Tests of a mounted reducer on an open station: rehearsed, measured, evaluated, recorded."""
