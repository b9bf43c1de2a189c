"""What all compiled parts use: bounds and histories."""

from __future__ import annotations

from . import compensator
from .compiled import compiled

clip = compiled(compensator.clip)


@compiled
def push(history, value):
    """Puts `value` in front of a history, newest first; the oldest falls out."""
    for i in range(len(history) - 1, 0, -1):
        history[i] = history[i - 1]
    history[0] = value


@compiled
def dot(taps, history, count):
    """Sum of the first `count` products."""
    total = 0.0
    for i in range(count):
        total += taps[i] * history[i]
    return total


@compiled
def fill_zero(history):
    """Forgets a history. (A slice assignment brings an error path that writes text.)"""
    for i in range(len(history)):
        history[i] = 0.0


@compiled
def copy(source, target):
    """All numbers of `source` into `target`."""
    for i in range(len(source)):
        target[i] = source[i]
