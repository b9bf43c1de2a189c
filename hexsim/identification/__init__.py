"""Identification of a machine behind its host interface: measure, trace, design the next motion, measure again."""

from hexsim.identification.rounds import Story, identify

__all__ = ["Story", "identify"]
