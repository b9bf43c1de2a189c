"""Machines with balances of their own: a folder with balances.toml, from its terms to a report."""
