"""Procedures with a rotating module: empty runs, and points against a rotating reference.

Profiles state speeds, ramps, temperatures and torques; the plans execute them.
"""
