"""The audit log: actions of people and software, chained by hashes."""
