"""Pages of operations: form, page of one operation, and list of all."""
