"""Motions that are asked for: formulas, paths, sampled files."""
