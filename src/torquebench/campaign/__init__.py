"""Campaigns: what a person wants done at once, as steps on an open station.

A campaign runs plans, fits and verifies models and registers what came out; both doors call
it and reports show its results. It prints nothing: progress goes to a listener.
"""
