"""The tests: a package, so that files of tests can share code."""
