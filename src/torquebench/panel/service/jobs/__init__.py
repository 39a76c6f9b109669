"""Jobs: what the bench works at, one at a time, each on a thread of its own."""
