"""The fit of the leg's numbers to windows of measured motion: Gauss-Newton in units of the prior's standard deviations.

Each window has a start state of its own (y, v, P1, P2), which is eliminated. A pass over all windows at given numbers gives the
cost and the normal equations; a step of Levenberg and Marquardt is one pass, whether it is kept or not.
"""

from __future__ import annotations

from math import exp, sqrt, tanh

from ..compiled import compiled, inlined
from .leg import (
    COULOMB_DN,
    COULOMB_UP,
    DEAD_DN,
    DEAD_UP,
    DELAY,
    DRIFT,
    GIVE,
    LN_STRIBECK,
    M1,
    M2,
    N_NUMBERS,
    N_SPOOL,
    P1,
    P2,
    PLAY,
    POSITION_LAG,
    REG,
    S_FOUR_WAY,
    S_TICK,
    SPREAD,
    STATIC_DN,
    STATIC_UP,
    V,
    Y,
    Z,
    tangent,
    warm_spool,
)  # fmt: skip

WINDOW, LEAD = 100, 150  # ticks of a window; volts before it, so that the side of a backlash is known
N_STATE = 4  # of a start: y, v, P1, P2
STATE_SCALE = (2e-5, 0.03, 3e4, 3e4)  # [m, m/s, Pa, Pa] prior of a start state about what is measured
KNOT = 5  # ticks in which the error of the other legs' load is one number: half of the span from which it is measured
KNOTS = WINDOW // KNOT
N_START = N_STATE + KNOTS  # a window's own: its start state, and on a platform those errors [N]
N_COLUMNS = N_NUMBERS + N_START
MOST_RESIDUAL = 1e3  # standard deviations
NARROW = 0.5  # of a valve's widest play: the mean of plays of every width below it, as magnetic hysteresis has
SLOPE_TICKS = 12  # of the volts, by which the side of the backlash is told at first
LAST = 8  # ticks back to which fourth differences of two ticks reach
MOST_COLOUR = 0.9  # correlation from tick to tick: beyond, noise cannot be told from motion
LATE = 8  # ticks by which a position may be read late
WARM = 24  # ticks that amplifier and spool move before a window begins: four lags of a spool of 25 Hz


@inlined
def follow(follower, volts, half):
    """Where a follower with a play of half width `half` is, and its derivative by that."""
    if follower < volts - half:
        return volts - half, -1.0
    if follower > volts + half:
        return volts + half, 1.0
    return follower, 0.0


@compiled
def behind_backlash(volts, half, spread, out, by_half, by_spread):
    """Volts (m,) behind the valve's hysteresis, and their derivatives by both: a play of half width `half`, and for a share `spread` one
    of NARROW of it."""
    first = volts[0] - volts[SLOPE_TICKS]
    wide_by = narrow_by = 1.0 if first > 0.0 else -1.0  # moves down: the follower is above
    wide, narrow = volts[0] + wide_by * half, volts[0] + narrow_by * NARROW * half
    for i in range(len(volts)):
        wide, moved = follow(wide, volts[i], half)
        wide_by = moved if moved != 0.0 else wide_by
        narrow, moved = follow(narrow, volts[i], NARROW * half)
        narrow_by = moved if moved != 0.0 else narrow_by
        out[i] = wide + spread * (narrow - wide)
        by_half[i] = wide_by + spread * (NARROW * narrow_by - wide_by)
        by_spread[i] = narrow - wide


@compiled
def begin_window(x, S, th, sheet, start, arriving, by_half, by_spread, d_now, d_before):
    """State and derivatives at a window's first tick. start: (y as it is read, v, P1, P2); arriving: volts (LEAD + WINDOW,) behind the
    backlash."""
    S[:, :] = 0.0
    warm_spool(x, S, th, sheet, arriving, by_half, by_spread, LEAD - WARM, LEAD, d_now, d_before)
    x[Y], x[V], x[P1], x[P2] = start[0] + th[POSITION_LAG] * start[1], start[1], start[2], start[3]
    x[M1], x[M2] = start[2], start[3]
    S[Y, N_NUMBERS] = S[V, N_NUMBERS + 1] = S[P1, N_NUMBERS + 2] = S[M1, N_NUMBERS + 2] = 1.0
    S[Y, N_NUMBERS + 1], S[Y, POSITION_LAG] = th[POSITION_LAG], start[1]
    if sheet[S_FOUR_WAY] != 0.0:  # otherwise the supply's, whatever the start says
        S[P2, N_NUMBERS + 3] = S[M2, N_NUMBERS + 3] = 1.0
    v = x[V]
    up = v >= 0.0
    coulomb, static = (COULOMB_UP, STATIC_UP) if up else (COULOMB_DN, STATIC_DN)
    cs, give = exp(th[LN_STRIBECK]), th[GIVE]
    fade, turn = exp(-abs(v) / cs), tanh(v / th[REG])
    dry = (th[coulomb] + th[static] * fade) * turn
    x[Z] = dry * give
    S[Z, coulomb], S[Z, static], S[Z, GIVE] = turn * give, fade * turn * give, dry
    S[Z, LN_STRIBECK] = th[static] * fade * abs(v) / cs * turn * give


@compiled
def tick_window(x, S, k, d_now, d_before, th, sheet, start, starts, arriving, by_half, by_spread, supply, extra, w):
    """One tick of a window, extra [N] by the other legs: k of 0 to WINDOW - 1. start (N_START,): of which `starts` count."""
    whole = int(th[DELAY] / sheet[S_TICK])
    split = th[DELAY] / sheet[S_TICK] - whole
    at = LEAD + k - whole
    d_now[PLAY], d_before[PLAY] = by_half[at], by_half[at - 1]
    d_now[SPREAD], d_before[SPREAD] = by_spread[at], by_spread[at - 1]
    knot, columns = -1, N_NUMBERS + N_STATE
    if starts > N_STATE:
        extra += start[N_STATE + k // KNOT]
        knot = columns + k // KNOT
        columns = knot + 1
    tangent(
        x, S, columns, N_SPOOL, True, th, sheet, arriving[at], arriving[at - 1], split, d_now, d_before, 0.0, supply, extra, knot, 0.0,
        1.0, w,
    )  # fmt: skip


@compiled
def add_row(row, r, scale, starts, A, B, C, a, b):
    """A residual r and the model's derivatives (N_NUMBERS + starts,) into the normal equations; scale (N_COLUMNS,) to prior units."""
    for i in range(N_NUMBERS + starts):
        row[i] *= scale[i]
    for i in range(N_NUMBERS):
        s = row[i]
        if s != 0.0:
            for j in range(i + 1):
                A[i, j] += s * row[j]
            a[i] += s * r
    for i in range(starts):
        s = row[N_NUMBERS + i]
        for j in range(N_NUMBERS):
            B[i, j] += s * row[j]
        for j in range(i + 1):
            C[i, j] += s * row[N_NUMBERS + j]
        b[i] += s * r


@compiled
def _roughness(residuals, lag):
    """Square of the last fourth difference of every lag-th residual; residuals (LAST + 1,), the newest last."""
    a, b, c = residuals[LAST], residuals[LAST - lag], residuals[LAST - 2 * lag]
    return (a - 4.0 * b + 6.0 * c - 4.0 * residuals[LAST - 3 * lag] + residuals[LAST - 4 * lag]) ** 2


@compiled
def _whiten(fit, k, r):
    """What a position's residual at tick k of a window, and the derivatives in fit.row, have beyond what the tick before says of them, in
    units of what is new in the noise: a transducer's filter colours it. Returns the residual. Of pressures this is not known: what a
    wrong leg leaves in them is as fast as noise."""
    before, residuals = fit.row_before, fit.residuals
    for j in range(LAST):
        residuals[j] = residuals[j + 1]
    residuals[LAST] = r
    if k >= LAST and not fit.folding:
        fit.rough[0] += _roughness(residuals, 1)
        fit.rough[1] += _roughness(residuals, 2)
    if fit.colour == 0.0:
        return r
    old, share = (fit.colour, 1.0) if k > 0 else (0.0, sqrt(1.0 - fit.colour * fit.colour))
    for j in range(N_NUMBERS + fit.starts):
        here = fit.row[j]
        fit.row[j] = (share * here - old * before[j]) / fit.new
        before[j] = here
    return (share * r - old * residuals[LAST - 1]) / fit.new


@compiled
def _fourth_difference(colour):
    """Variance of fourth differences of a noise of variance 1 and this correlation from reading to reading."""
    c = colour
    return 70.0 + c * (-112.0 + c * (56.0 + c * (-16.0 + 2.0 * c)))


@compiled
def colour_of(rough):
    """Correlation of a noise from tick to tick, by its fourth differences of one tick and of two, squared, rough (2,); and the standard
    deviation of what is new each tick, over that of a white noise with the same fourth differences."""
    low, high = 0.0, MOST_COLOUR
    for _ in range(12):
        middle = 0.5 * (low + high)
        if _fourth_difference(middle * middle) * rough[0] < rough[1] * _fourth_difference(middle):
            low = middle
        else:
            high = middle
    return low, sqrt(70.0 * (1.0 - low * low) / _fourth_difference(low))


@compiled
def _count_row(fit, age_s, r):
    """A residual and its derivatives in fit.row into the normal equations. age_s: for which the valve's null has drifted."""
    fit.row[DRIFT] = age_s * (fit.row[DEAD_UP] - fit.row[DEAD_DN])
    add_row(fit.row, r, fit.scale, fit.starts, fit.A, fit.B, fit.C, fit.a, fit.b)


@compiled
def read_tick(fit, k, age_s, sheet, y, p1, p2, sy, sp, chi):
    """Residuals of the transducers at tick k into the normal equations; chi (2,): squared residuals of position and pressures. age_s:
    for which the valve's null has drifted, in fit.of_window already.

    The position is read late: fit.late (LATE, 2) and late_S (LATE, 2, N_COLUMNS) hold y, v and their derivatives of the last ticks, the
    rest of a tick is straight. Before the window the motion goes on straight."""
    x, S, late, late_S, th = fit.x, fit.S, fit.late, fit.late_S, fit.of_window
    row, columns = fit.row, N_NUMBERS + fit.starts
    place, back = k % LATE, min(int(th[POSITION_LAG] / sheet[S_TICK] + 0.5), k, LATE - 1)
    late[place, 0], late[place, 1] = x[Y], x[V]
    for j in range(columns):
        late_S[place, 0, j], late_S[place, 1, j] = S[Y, j], S[V, j]
    place, rest = (k - back) % LATE, th[POSITION_LAG] - back * sheet[S_TICK]
    speed = late[place, 1]
    for j in range(columns):
        row[j] = (late_S[place, 0, j] - rest * late_S[place, 1, j]) / sy
    row[POSITION_LAG] -= speed / sy
    r = (y - (late[place, 0] - rest * speed)) / sy
    r = _whiten(fit, k, min(max(r, -MOST_RESIDUAL), MOST_RESIDUAL))
    chi[0] += r * r
    _count_row(fit, age_s, r)
    for channel in range(2 if sheet[S_FOUR_WAY] != 0.0 else 1):
        m, pressure = (M1, p1) if channel == 0 else (M2, p2)
        for j in range(columns):
            row[j] = S[m, j] / sp
        r = min(max((pressure - x[m]) / sp, -MOST_RESIDUAL), MOST_RESIDUAL)
        chi[1] += r * r
        _count_row(fit, age_s, r)


@compiled
def cholesky(A, n):
    """Lower factor in place; False where A is not positive definite."""
    for i in range(n):
        for j in range(i + 1):
            s = A[i, j]
            for k in range(j):
                s -= A[i, k] * A[j, k]
            if i == j:
                if not s > 0.0:
                    return False
                A[i, i] = sqrt(s)
            else:
                A[i, j] = s / A[j, j]
    return True


@compiled
def forward(L, n, b):
    """L x = b in place."""
    for i in range(n):
        s = b[i]
        for k in range(i):
            s -= L[i, k] * b[k]
        b[i] = s / L[i, i]


@compiled
def backward(L, n, b):
    """L' x = b in place."""
    for i in range(n - 1, -1, -1):
        s = b[i]
        for k in range(i + 1, n):
            s -= L[k, i] * b[k]
        b[i] = s / L[i, i]


@compiled
def variances(L, times, out, spare):
    """The diagonal of times (L L')^-1 into out (N_NUMBERS,): squares of L^-1 e_k. spare (N_NUMBERS,)."""
    for k in range(N_NUMBERS):
        spare[:] = 0.0
        spare[k] = 1.0
        forward(L, N_NUMBERS, spare)
        out[k] = 0.0
        for j in range(k, N_NUMBERS):
            out[k] += times * spare[j] * spare[j]


@compiled
def eliminate(starts, A, B, C, a, b, H, g, KB, kb):
    """Adds a window with its start state eliminated to H (lower), g. KB (N_START, N_NUMBERS), kb (N_START,) give the start's step
    kb - KB d for a step d of the numbers. C is factored in place (its prior is in it). Returns what the step kb takes off the cost."""
    cholesky(C, starts)
    gain = 0.0
    for i in range(starts):
        kb[i] = b[i]
    forward(C, starts, kb)
    for i in range(starts):
        gain += kb[i] * kb[i]
    for j in range(N_NUMBERS):  # KB = L^-1 B
        for i in range(starts):
            s = B[i, j]
            for k in range(i):
                s -= C[i, k] * KB[k, j]
            KB[i, j] = s / C[i, i]
    for i in range(N_NUMBERS):
        for j in range(i + 1):
            s = A[i, j]
            for k in range(starts):
                s -= KB[k, i] * KB[k, j]
            H[i, j] += s
        s = a[i]
        for k in range(starts):
            s -= KB[k, i] * kb[k]
        g[i] += s
    backward(C, starts, kb)
    for j in range(N_NUMBERS):  # KB = C^-1 B
        for i in range(starts - 1, -1, -1):
            s = KB[i, j]
            for k in range(i + 1, starts):
                s -= C[k, i] * KB[k, j]
            KB[i, j] = s / C[i, i]
    return gain
