"""Tables of readings in and out: columns with units, file formats, errors by row."""
