"""Procedures while a module turns by itself: empty runs, and points against a rotating reference.

Profiles say speeds, ramps, temperatures and torques; the plans follow them.
"""
