"""Instruments behind narrow roles: `base` says what a role is, one file a wire protocol.

`simulated` is the only file of the bench that knows the twin.
"""
