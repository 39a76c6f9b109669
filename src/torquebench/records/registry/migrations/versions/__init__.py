"""The versions of the schema, from the oldest to the newest."""
