"""Entries of what people and software did, chained by hashes."""
