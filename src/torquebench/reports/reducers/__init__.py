"""Reports on tests of reducers and on their comparison."""
