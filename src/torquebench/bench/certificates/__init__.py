"""Certificates of equipment as the description of a bench states them."""
