"""What all compiled parts use: bounds, histories and the noise of readings."""

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
def next_noise(noise, a, b, c, d, e):
    """The noise of readings after one more, a to e the last five: a running median of fourth differences, in which motion is small.

    A step of 0.002 a reading knows the median to 3 %, and is twice as large after 0.7 s.
    """
    usual = 0.6745 * 70.0**0.5 * noise  # median of a normal noise's
    off = abs(a - 4.0 * b + 6.0 * c - 4.0 * d + e)
    return noise * (1.002 if off > usual else 0.998)


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
    """All numbers of `source` into `target`. (A slice assignment brings an error path, and room for arrays that overlap.)"""
    for i in range(len(source)):
        target[i] = source[i]


@compiled
def copy_rows(source, target):
    """`copy` of a matrix."""
    for i in range(len(source)):
        copy(source[i], target[i])
