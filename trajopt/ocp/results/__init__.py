"""A solved problem: what is known about it, its report, its file, its pictures."""
