"""The simulated bench: the one driver that knows the twin."""
