"""The registry: tables, entries and migrations of calibrations, models, certificates, equipment."""
