"""The commands: each file is a script of its own, and a word after `rimless`."""
