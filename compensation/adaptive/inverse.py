"""Volts that make the model's leg follow a demanded motion: nonlinear least squares over a receding window of ticks.

Each tick one more set of volts is kept. The residuals of a window of `AHEAD` ticks are the acceleration's error in a low pass,
those of speed and position, and the second difference of the volts. The derivatives are those of the model with blunt edges,
so that they know of an edge on the other side of a dead band: bluntest in the ticks that have just come into sight. The residuals
are the model's own.
"""

from __future__ import annotations

from math import inf

from ..compiled import compiled
from .fit import backward, cholesky, forward
from .leg import DEAD_DN, DEAD_UP, DELAY, S_PASS, S_POLE1, S_POLE2, S_TICK, V, Y, tangent, tick

AHEAD = 14  # ticks: 28 ms, longer than a spool of 25 Hz takes to cross
FELT_HZ = 60.0  # corner of the low pass, of second order: above the band in which a bump is judged
# [m/s2, m/s, m, V]: two thirds of what is just perceived (step.PERCEIVED_m_s2); what is not felt; a narrow dead band from edge to edge
WEIGHTS = (1e-2, 1e-3, 1e-4, 9e-2)
TRIES = 3  # steps a tick: the window moves on, and the next tick goes on
SETTLED = 4.0  # cost of residuals of a quarter of their units: below, the next step has what this one leaves
LEAST_GAIN = 0.1  # of the cost, by a step: a third of the unit of one residual, 0.003 m/s2
BLUNT = 0.4  # of the half dead band, for the derivatives of the last tick
LEAST_BLUNT_V = 2e-3  # where there is no dead band: a few steps of a 14-bit output of 10 V
ROUGHEST = 2.0 / 3.0  # of the half dead band, as WEIGHTS[3]: a wide one is crossed in as many ticks as a narrow one
DAMPING = 1e-3  # of a step, so that volts that move nothing stay
SHARES = (1.0, 0.3, 0.1)  # of a step that are tried


@compiled
def low_pass(memory, x, sheet):
    """One tick of the low pass; memory (2,)."""
    o = sheet[S_PASS] * x + memory[0]
    memory[0] = 2.0 * sheet[S_PASS] * x - sheet[S_POLE1] * o + memory[1]
    memory[1] = sheet[S_PASS] * x - sheet[S_POLE2] * o
    return o


@compiled
def roughness(th):
    """What a second difference of the volts weighs [1/V]."""
    return 1.0 / max(WEIGHTS[3], ROUGHEST * 0.5 * (th[DEAD_UP] + th[DEAD_DN]))


@compiled
def window_cost(x, U, before, older, y, v, filtered, th, sheet, split, supply, extra, r, s, none, w, path, most):
    """Residuals r (4 AHEAD,) of volts U (AHEAD,) from the state x. before, older: the volts sent last. y, v (AHEAD + 1,): demanded at
    the window's ticks. extra (AHEAD,): by the other legs [N]. path (AHEAD + 1, N_STATES) takes the states. Ends where the cost is
    beyond `most`."""
    s[:] = x
    path[0, :] = x
    g0, g1 = filtered[0], filtered[1]
    cost, tick_s, rough = 0.0, sheet[S_TICK], roughness(th)
    for i in range(AHEAD):
        last = U[i - 1] if i > 0 else before
        last2 = U[i - 2] if i > 1 else (before if i == 1 else older)
        speed = s[V]
        tick(s, none, th, sheet, U[i], last, split, supply, extra[i], w)
        path[i + 1, :] = s
        e = ((s[V] - speed) - (v[i + 1] - v[i])) / tick_s
        o = sheet[S_PASS] * e + g0
        g0 = 2.0 * sheet[S_PASS] * e - sheet[S_POLE1] * o + g1
        g1 = sheet[S_PASS] * e - sheet[S_POLE2] * o
        r[i] = o / WEIGHTS[0]
        r[AHEAD + i] = (s[V] - v[i + 1]) / WEIGHTS[1]
        r[2 * AHEAD + i] = (s[Y] - y[i + 1]) / WEIGHTS[2]
        r[3 * AHEAD + i] = (U[i] - 2.0 * last + last2) * rough
        for k in range(4):
            cost += r[k * AHEAD + i] * r[k * AHEAD + i]
        if cost > most:
            break
    return cost


@compiled
def window_slope(path, U, before, th, sheet, split, supply, extra, blunt, J, S, d_now, d_before, s, w):
    """J (4 AHEAD, AHEAD): derivatives of the residuals by the volts, along the states `path`."""
    S[:, :] = 0.0
    J[:, :] = 0.0
    tick_s, rough = sheet[S_TICK], roughness(th)
    for j in range(AHEAD):
        d_now[j] = d_before[j] = 0.0
    for i in range(AHEAD):
        d_now[i] = 1.0
        if i > 0:
            d_now[i - 1], d_before[i - 1] = 0.0, 1.0
        if i > 1:
            d_before[i - 2] = 0.0
        s[:] = path[i]
        last = U[i - 1] if i > 0 else before
        for j in range(i + 1):
            J[i, j] = -S[V, j]
        tangent(
            s,
            S,
            i + 1,
            i + 1,
            False,
            th,
            sheet,
            U[i],
            last,
            split,
            d_now,
            d_before,
            0.0,
            supply,
            extra[i],
            -1,
            max(blunt * (i / (AHEAD - 1.0)) ** 2, LEAST_BLUNT_V),  # the next ticks have been solved for many times
            1.0,
            w,
        )
        for j in range(i + 1):
            J[i, j] = (J[i, j] + S[V, j]) / tick_s
            J[AHEAD + i, j] = S[V, j] / WEIGHTS[1]
            J[2 * AHEAD + i, j] = S[Y, j] / WEIGHTS[2]
        J[3 * AHEAD + i, i] = rough
        if i > 0:
            J[3 * AHEAD + i, i - 1] = -2.0 * rough
        if i > 1:
            J[3 * AHEAD + i, i - 2] = rough
    for j in range(AHEAD):  # the low pass, column by column
        g0 = g1 = 0.0
        for i in range(j, AHEAD):
            e = J[i, j]
            o = sheet[S_PASS] * e + g0
            g0 = 2.0 * sheet[S_PASS] * e - sheet[S_POLE1] * o + g1
            g1 = sheet[S_PASS] * e - sheet[S_POLE2] * o
            J[i, j] = o / WEIGHTS[0]


@compiled
def _normal(J, H):
    """H = J'J, lower half: row by row of J, whose columns begin one after the other."""
    H[:, :] = 0.0
    for i in range(AHEAD):
        felt, speed, place, rough = J[i], J[AHEAD + i], J[2 * AHEAD + i], J[3 * AHEAD + i]
        for a in range(i + 1):
            row = H[a]
            for b in range(a + 1):
                row[b] += felt[a] * felt[b] + speed[a] * speed[b] + place[a] * place[b]
                row[b] += rough[a] * rough[b]


@compiled
def _smooth(U, before):
    """Volts U (AHEAD,) averaged with their neighbours: a step's second difference falls to a half."""
    last = before
    for i in range(AHEAD):
        now = U[i]
        U[i] = 0.25 * (last + 2.0 * now + U[min(i + 1, AHEAD - 1)])
        last = now


@compiled
def _take(U, r, path, other, its_r, its_path):
    """Other volts, with their residuals and states."""
    U[:] = other
    r[:] = its_r
    path[:, :] = its_path


@compiled
def _solve(x, U, before, older, y, v, filtered, th, sheet, supply, extra, limit_V, ws):
    """Up to TRIES steps of U (AHEAD,), in place. Returns the cost."""
    split = th[DELAY] / sheet[S_TICK] - int(th[DELAY] / sheet[S_TICK])
    r, r2, J, S, path, path2, H, L, step, U2, s, w, d_now, d_before = (
        ws.r, ws.r2, ws.J, ws.S, ws.path, ws.path2, ws.H, ws.L, ws.step, ws.U2, ws.s, ws.w, ws.d_now, ws.d_before,
    )  # fmt: skip
    cost = window_cost(x, U, before, older, y, v, filtered, th, sheet, split, supply, extra, r, s, S, w, path, inf)
    half = 0.5 * (th[DEAD_UP] + th[DEAD_DN])
    soft = max(BLUNT * half, LEAST_BLUNT_V)
    for _ in range(TRIES if cost > LEAST_GAIN else 0):
        window_slope(path, U, before, th, sheet, split, supply, extra, soft, J, S, d_now, d_before, s, w)
        _normal(J, H)
        for a in range(AHEAD):
            for b in range(a + 1):
                L[a, b] = H[a, b]
            L[a, a] *= 1.0 + DAMPING
            total = 0.0
            for i in range(a, AHEAD):
                total += J[i, a] * r[i] + J[AHEAD + i, a] * r[AHEAD + i] + J[2 * AHEAD + i, a] * r[2 * AHEAD + i]
                total += J[3 * AHEAD + i, a] * r[3 * AHEAD + i]
            step[a] = total
        better, promised = False, 0.0
        if cholesky(L, AHEAD):
            forward(L, AHEAD, step)
            for a in range(AHEAD):
                promised += step[a] * step[a]
            if promised < LEAST_GAIN and cost < SETTLED:
                break
            backward(L, AHEAD, step)
            for share in SHARES:
                for a in range(AHEAD):
                    U2[a] = min(max(U[a] - share * step[a], -limit_V), limit_V)
                c2 = window_cost(
                    x, U2, before, older, y, v, filtered, th, sheet, split, supply, extra, r2, s, S, w, path2, cost
                )
                if c2 < cost:
                    better = True
                    break
        if better:
            done = cost - c2 < 1e-3 * cost or (
                c2 < SETTLED and abs(promised - (cost - c2)) < LEAST_GAIN
            )  # then little is left
            cost = c2
            _take(U, r, path, U2, r2, path2)
            if done:
                break
        elif soft > LEAST_BLUNT_V:
            soft = max(0.25 * soft, LEAST_BLUNT_V)
        else:
            break
    return cost


@compiled
def improve(x, U, before, older, y, v, filtered, th, sheet, supply, extra, limit_V, ws):
    """Volts U (AHEAD,), in place. Returns the cost. Where they leave more than the residuals' own sizes, it also begins from the smoothed
    volts of steady motion, ws.steady (AHEAD,): a dead band between makes a minimum on either side."""
    cost = _solve(x, U, before, older, y, v, filtered, th, sheet, supply, extra, limit_V, ws)
    if cost > 4.0 * AHEAD:
        _smooth(ws.steady, before)
        other = _solve(x, ws.steady, before, older, y, v, filtered, th, sheet, supply, extra, limit_V, ws)
        if other < cost:
            U[:] = ws.steady
            return other
    return cost


@compiled
def keep_first(x, U, sent, before, y, v, filtered, th, sheet, supply, extra, none, w):
    """The window moves on by a tick: the state under the volts that were sent, the low pass' state, and the volts shifted."""
    split = th[DELAY] / sheet[S_TICK] - int(th[DELAY] / sheet[S_TICK])
    speed = x[V]
    tick(x, none, th, sheet, sent, before, split, supply, extra[0], w)
    e = ((x[V] - speed) - (v[1] - v[0])) / sheet[S_TICK]
    o = low_pass(filtered, e, sheet)
    for i in range(AHEAD - 1):
        U[i] = U[i + 1]
    return o
