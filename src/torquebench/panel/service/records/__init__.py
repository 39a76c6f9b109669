"""Records for pages and clients, and the import of calibration tables."""
