"""The command lines of rimless-gym, and the studies behind them.

Unlike the rest of this package, these files stand above `trajopt` and `agents`. Each command is a
module with a `main`; `rimless_gym.command` runs it for a word after `rimless`, and a file of
`scripts/` in a checkout.
"""
