"""The experiments of the thesis, solved again."""
