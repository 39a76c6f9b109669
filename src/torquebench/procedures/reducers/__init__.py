"""Plans of the tests of a reducer."""
