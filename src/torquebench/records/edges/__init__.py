"""Recorded edges: encoding, the stream on the disk, and the archive of a run."""
