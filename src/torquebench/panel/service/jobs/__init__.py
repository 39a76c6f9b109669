"""Jobs: the bench's tasks, one at a time, each on a separate thread."""
