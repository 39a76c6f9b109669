"""Recorded streams in the formats of other programs: HDF5, MDF4, TDMS."""
