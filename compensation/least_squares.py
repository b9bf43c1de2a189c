"""Linear least squares row by row: Givens rotations into a triangle (Golub, Van Loan, Matrix Computations, 5.2.5).

min |A x - b|: each row of [A b] is rotated into the triangle [R c] and forgotten; R x = c at the end. So a problem of a
thousand rows needs the memory of its unknowns, and is as exact as an orthogonal factorisation of the whole.
"""

from __future__ import annotations

from math import sqrt

from .compiled import compiled


@compiled
def start_least_squares(work, n):
    """No rows yet, n unknowns."""
    for i in range(n + 1):
        for j in range(n + 1):
            work.triangle[i, j] = 0.0


@compiled
def add_row(work, n):
    """The row in `work.row`: n coefficients and the right side. The row is lost."""
    triangle, row = work.triangle, work.row
    for i in range(n):
        if row[i] == 0.0:
            continue
        size = sqrt(triangle[i, i] * triangle[i, i] + row[i] * row[i])
        cosine, sine = triangle[i, i] / size, row[i] / size
        for j in range(i, n + 1):
            above = triangle[i, j]
            triangle[i, j] = cosine * above + sine * row[j]
            row[j] = cosine * row[j] - sine * above


@compiled
def solve(work, n, found):
    """The unknowns into `found`; the rows must have determined all of them."""
    for i in range(n - 1, -1, -1):
        rest = work.triangle[i, n]
        for j in range(i + 1, n):
            rest -= work.triangle[i, j] * found[j]
        found[i] = rest / work.triangle[i, i]
