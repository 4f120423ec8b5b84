"""The feedback laws, one per file: each has a function `design(solution) -> Controller`."""
