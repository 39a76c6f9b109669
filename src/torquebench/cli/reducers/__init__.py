"""Commands that test reducers and compare them."""
