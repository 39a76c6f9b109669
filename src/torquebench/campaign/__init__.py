"""Campaigns: complete tasks of a user, as steps on an open station.

A campaign runs plans, fits and verifies models and registers the results for command line, panel,
API and reports. It prints nothing: progress goes to a listener.
"""
