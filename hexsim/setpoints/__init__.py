"""Commanded motions: formulas, paths, sampled files."""
