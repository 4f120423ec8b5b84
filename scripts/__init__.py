"""The commands of rimless-gym: each file is a script of its own, and a word after `rimless`."""
