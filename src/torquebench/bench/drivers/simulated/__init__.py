"""The simulated bench: the only driver that uses the twin."""
