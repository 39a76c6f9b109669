"""A job on a page: panel, preview and strip."""
