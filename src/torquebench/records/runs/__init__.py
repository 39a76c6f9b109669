"""Folders of runs: events, streams and manifest; listing, locking and finding unfinished ones."""
