"""SCPI over TCP: link and instruments."""
