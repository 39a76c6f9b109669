"""The operator panel: the bench in a browser, and the same operations over HTTP."""
