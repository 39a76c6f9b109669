"""Records: runs, calibrations, certificates, drift, and tables from elsewhere."""
