"""Records: runs, calibrations, certificates, drift, and tables from another source."""
