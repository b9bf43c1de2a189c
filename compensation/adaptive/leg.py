"""The leg as the estimator knows it: one control tick, and its derivatives with respect to state, numbers and volts.

Volts pass hysteresis (two plays), a delay (`arriving`), an amplifier's lag and the spool (second order). Edges are rounded, those of
the two directions unlike, and close exponentially or with a clearance; their opening may be bent; a four-way valve's four overlaps are
unlike. Orifices turn from laminar to turbulent; the return line and leaks are laminar; oil is softened by air. Friction is Stribeck's
behind one bristle (LuGre without damping), regularised in velocity (steady: F = g tanh(v/reg) + viscous v):

    z' = v - v coth(v/reg) sigma z / g(v),   F = sigma z + viscous v,   g = Fc + Fs exp(-|v|/cs),   sigma = 1/give

    r m v' = P1 A1 - P2 A2 - F - F0 - K (y - stroke/2) - E        K: a spring, cables; m: while all legs of a platform move
                                               alike; r, E: share of it that the leg moves by itself and what the others' forces
                                               give [N]; r = 1, E = 0 alone
    C1 P1' = Q1 - A1 v,   C2 P2' = Q2 + A2 v      a rod side at supply pressure has P2 = Ps

Integrated by a semi-implicit Euler scheme of `SUBSTEPS` steps a tick: the same in estimation and inversion. The flow is that of the
spool at the middle of a step, so that valve and oil are of second order in it. Lags of first order take implicit steps: late by the
lag itself however short it is, so that the fit sees a lag of nothing grow.
State (N_STATES,): y, v, P1, P2, spool [V], its rate, amplifier [V], bristle [m], P1 and P2 as measured. SI units, volts.
"""

from __future__ import annotations

from math import exp, log, log1p, sqrt

from ..compiled import compiled, inlined

SUBSTEPS = 10  # of a tick: 0.2 ms
N_STATES = 10  # y to the pressures as measured
(Y, V, P1, P2, X, XD, AMP, Z, M1, M2) = range(N_STATES)
NAMES = (
    "ln_spool", "zeta", "amp_lag_s", "delay_s", "play_V", "spread",  # what acts on the spool first
    "gain_up", "gain_dn", "dead_up_V", "dead_dn_V", "ln_round_V", "bend", "bend2", "ln_turbulent", "ln_laminar", "leak", "leak_tank",
    "soft", "air", "mass", "hold", "coulomb_up", "coulomb_dn", "static_up", "static_dn", "viscous_up", "viscous_dn", "ln_stribeck",
    "reg_m_s", "give_m_N", "pressure_lag_s", "position_lag_s", "spring", "ln_round_ratio", "return_line", "drift_V_s", "notch", "tail",
    "skew_up_V", "skew_dn_V", "leak_supply", "leak_supply_top", "leak_tank_top",  # of a four-way valve alone
)  # fmt: skip
N_NUMBERS, N_SPOOL = len(NAMES), 6  # of these the first act on the spool
(
    LN_SPOOL, ZETA, AMP_LAG, DELAY, PLAY, SPREAD, GAIN_UP, GAIN_DN, DEAD_UP, DEAD_DN, LN_ROUND, BEND, BEND2, LN_TURBULENT, LN_LAMINAR,
    LEAK, LEAK_TANK, SOFT, AIR, MASS, HOLD, COULOMB_UP, COULOMB_DN, STATIC_UP, STATIC_DN, VISCOUS_UP, VISCOUS_DN, LN_STRIBECK, REG,
    GIVE, PRESSURE_LAG, POSITION_LAG, SPRING, LN_ROUND_RATIO, RETURN, DRIFT, NOTCH, TAIL, SKEW_UP, SKEW_DN,
    LEAK_SUPPLY, LEAK_SUPPLY_TOP, LEAK_TANK_TOP,
) = range(N_NUMBERS)  # fmt: skip
N_SHEET = 14  # places in a sheet (N_SHEET,): what is declared
(
    S_A1, S_A2, S_FLOW, S_E, S_V1, S_V2, S_STROKE, S_TANK, S_FOUR_WAY, S_TICK, S_PASS, S_POLE1, S_POLE2, S_OWN,
) = range(N_SHEET)  # fmt: skip
N_SPACE = 18  # of an opening, an orifice and a chamber, with their derivatives
ATMOSPHERE_Pa = 1.0e5  # of free air, as its share is counted
LEAST_PRESSURE_Pa = 1.0e4  # below, oil boils, which this leg does not know
CORNER = log(2.0)  # an edge is open by this times its rounding where it begins to open
LEAST_COLUMN_m = 1e-3  # of oil, so that a reading beyond an end of the stroke has a volume


@compiled
def valve_lag_s(n):
    """Lag of amplifier, spool and delay at low frequencies, of numbers n (N_NUMBERS,) [s]."""
    return n[ZETA] / 3.141592653589793 * exp(-n[LN_SPOOL]) + n[AMP_LAG] + n[DELAY]


@inlined
def opening(travel, s, tail, notch, b, b2, out):
    """Opening of an edge [V] for travel past it, rounded by s, bent by b, b2. It closes exponentially, and to a share `tail` as an edge
    with clearance does, t/2 + sqrt(t^2/4 + (s ln 2)^2): both open by s ln 2 at the edge. notch: share that its linear part lacks.
    out (7,): it, and by travel, ln s, b, b2, notch, tail."""
    q = travel / s
    if q > 30.0:
        a, p, lns = travel, 1.0, 0.0
    elif q > -30.0:
        e = exp(q)
        a = s * log1p(e)
        p = e / (1.0 + e)
        lns = a - travel * p
    else:
        a = p = lns = 0.0
    far = sqrt(0.25 * travel * travel + CORNER * CORNER * s * s)
    more = 0.5 * travel + far - a
    a += tail * more
    p += tail * (0.5 + 0.25 * travel / far - p)
    lns += tail * (CORNER * CORNER * s * s / far - lns)
    slope = 1.0 - notch + a * (2.0 * b + 3.0 * b2 * a)
    out[0] = a * (1.0 - notch + a * (b + b2 * a))
    out[1], out[2], out[3], out[4], out[5], out[6] = slope * p, slope * lns, a * a, a * a * a, -a, slope * more


@inlined
def orifice(o, dp, turbulent, laminar, out):
    """o dp/(dp^2 + (turbulent + laminar/o^2)^2)^(1/4). out: it, and its derivatives by o, dp, turbulent, laminar."""
    n = o * o
    if n < 1e-14:
        out[0] = out[1] = out[2] = out[3] = out[4] = 0.0
        return
    w = turbulent * n + laminar
    r2 = sqrt(n * n * dp * dp + w * w)
    r = sqrt(r2)
    f = n * dp / r
    k = f / (2.0 * r2 * r2)
    out[0] = f
    out[1] = 2.0 * o * (dp / r - k * (n * dp * dp + w * turbulent))
    out[2] = n / r - k * n * n * dp
    out[3] = -k * w * n
    out[4] = -k * w


@inlined
def behind_line(q, o, dp, gain, line):
    """What `orifice` gave of o and dp, with a laminar return line [Pa s/m3] behind, where gain times it flows: that of dp - line gain q,
    by one step of Newton from no flow (within (line gain q/dp)^2/8). q (7,): it, and its derivatives; [5] by gain, over it, [6] by the
    line."""
    f = q[0]
    if f == 0.0:
        q[5] = q[6] = 0.0
        return
    r, e = line * gain * q[2], q[2] * dp / f  # e: 1/2 turbulent, 1 laminar
    s, bent = 1.0 / (1.0 + r), 4.0 * r * (1.0 - e) / e
    s2 = s * s
    q[5], q[6] = f * s2, -f * gain * q[2] * s2
    q[0] = f * s
    q[1] = s2 * (q[1] + bent * (q[1] - f / o))
    q[2] *= s2 * (1.0 + r * (1.0 + (1.0 - e) * (5.0 * e - 2.0) / (e * e)))
    q[3] *= s2 * (1.0 + bent)
    q[4] *= s2 * (1.0 + bent)


@compiled
def capacity(volume, P, E, air, out):
    """Oil and free air (isothermal, volume fraction at one bar). out: dV/dP, and its derivatives by volume, P, air."""
    p = P if LEAST_PRESSURE_Pa < P else LEAST_PRESSURE_Pa
    gas = ATMOSPHERE_Pa / (p * p)
    each = 1.0 / E + air * gas
    out[0], out[1] = volume * each, each
    out[2] = -2.0 * volume * air * gas / p if LEAST_PRESSURE_Pa < P else 0.0
    out[3] = volume * gas


@inlined
def sliding(v, reg):
    """v coth(v/reg), and its derivatives by v and ln reg."""
    q, sign = abs(v) / reg, 1.0 if v >= 0.0 else -1.0
    if q > 20.0:
        return abs(v), sign, 0.0
    if q < 1e-4:
        return reg, 2.0 / 3.0 * q * sign, reg
    e = exp(-2.0 * q)
    coth, inverse = (1.0 + e) / (1.0 - e), 4.0 * e / ((1.0 - e) * (1.0 - e))  # of sinh^2
    return reg * q * coth, sign * (coth - q * inverse), reg * q * q * inverse


@inlined
def spool_step(x, S, moving, numbers, u, share, by_delay, d_now, d_before, gain_y, h, ka, dka, om, zeta):
    """One step h of amplifier and spool, and of their derivatives. u: volts, the share of them from before; by_delay: du by DELAY."""
    damped = 1.0 / (1.0 + 2.0 * zeta * om * h)
    Sy, Sx, Sd, Sa = S[Y], S[X], S[XD], S[AMP]
    err = x[AMP] - x[X]
    rate = (x[XD] + h * om * om * err) * damped
    x[XD] = rate
    x[X] += h * rate
    f1 = damped * h * om * om
    for j in range(moving):
        Sd[j] = damped * Sd[j] + f1 * (Sa[j] - Sx[j])
    if numbers:
        Sd[LN_SPOOL] += 2.0 * f1 * err - rate * damped * 2.0 * zeta * om * h
        Sd[ZETA] -= rate * damped * 2.0 * om * h
    for j in range(moving):
        Sx[j] += h * Sd[j]
    away = u - x[AMP]
    x[AMP] += ka * away
    for j in range(moving):
        Sa[j] += ka * (d_now[j] + share * (d_before[j] - d_now[j]) - gain_y * Sy[j] - Sa[j])
    if numbers:
        Sa[AMP_LAG] += dka * away
        Sa[DELAY] += ka * by_delay


@compiled
def warm_spool(x, S, th, sheet, arriving, by_half, by_spread, first, last, d_now, d_before):
    """Amplifier and spool with their derivatives from tick `first` on, where they have followed arriving[first], to tick `last`."""
    h = sheet[S_TICK] / SUBSTEPS
    whole = int(th[DELAY] / sheet[S_TICK])
    edge = (th[DELAY] / sheet[S_TICK] - whole) * SUBSTEPS
    ka = h / (th[AMP_LAG] + h)
    dka = -ka * ka / h
    om = 6.283185307179586 * exp(th[LN_SPOOL])
    x[AMP] = x[X] = arriving[first - whole]
    x[XD] = 0.0
    S[AMP, PLAY] = S[X, PLAY] = by_half[first - whole]
    S[AMP, SPREAD] = S[X, SPREAD] = by_spread[first - whole]
    for k in range(first, last):
        now, before = arriving[k - whole], arriving[k - whole - 1]
        d_now[PLAY], d_before[PLAY] = by_half[k - whole], by_half[k - whole - 1]
        d_now[SPREAD], d_before[SPREAD] = by_spread[k - whole], by_spread[k - whole - 1]
        for i in range(SUBSTEPS):
            share = edge - i
            slope = (before - now) / h if share >= 0.0 and share < 1.0 else 0.0
            share = 1.0 if share > 1.0 else (0.0 if share < 0.0 else share)
            u = now + share * (before - now)
            spool_step(x, S, N_SPOOL, True, u, share, slope, d_now, d_before, 0.0, h, ka, dka, om, th[ZETA])


@compiled
def tangent(
    x,
    S,
    n,
    moving,
    numbers,
    th,
    sheet,
    now_V,
    before_V,
    split,
    d_now,
    d_before,
    gain_y,
    supply,
    extra,
    knot,
    blunt_V,
    falls,
    w,
):
    """`tick`, and S (N_STATES, n) with it, the state's derivatives by whatever its columns are.

    moving: how many columns, the first, move the spool; those behind are zero there. numbers: whether the first N_NUMBERS columns
    are the leg's numbers, which act directly too. d_now, d_before (n,): of now_V and before_V. gain_y: volts that a position loop
    takes off per metre of y. knot: column of the derivative by `extra` at this tick, or -1. falls: 1; 0: without what the
    fall of friction with speed does to them, for stick-slip, which it starts, is bounded. Everything else as in `tick`.
    """
    h = sheet[S_TICK] / SUBSTEPS
    a1, a2, four = sheet[S_A1], sheet[S_A2], sheet[S_FOUR_WAY] != 0.0
    s_up, s_dn = exp(th[LN_ROUND]), exp(th[LN_ROUND] + th[LN_ROUND_RATIO])
    rounds_up, rounds_dn = 1.0 if s_up > blunt_V else 0.0, 1.0 if s_dn > blunt_V else 0.0
    s_up, s_dn = max(s_up, blunt_V), max(s_dn, blunt_V)
    om = 6.283185307179586 * exp(th[LN_SPOOL])
    ka = h / (th[AMP_LAG] + h)
    dka = -ka * ka / h
    kp = h / (th[PRESSURE_LAG] + h)
    dkp = -kp * kp / h
    E = sheet[S_E] / (1.0 + th[SOFT])
    cs, reg, sigma = exp(th[LN_STRIBECK]), th[REG], 1.0 / th[GIVE]
    turbulent, laminar = exp(th[LN_TURBULENT]), exp(th[LN_LAMINAR])
    flow = sheet[S_FLOW]
    gu, gd = flow * th[GAIN_UP], flow * th[GAIN_DN]
    tank, m = sheet[S_TANK], th[MASS] * sheet[S_OWN]
    edge = split * SUBSTEPS
    o, q, c = w[0:7], w[7:14], w[14:18]
    Sy, Sv, S1, S2, Sx, Sd, Sz, T1, T2 = S[Y], S[V], S[P1], S[P2], S[X], S[XD], S[Z], S[M1], S[M2]
    if not four:
        x[P2] = x[M2] = supply
    for i in range(SUBSTEPS):
        share = edge - i
        changes = share >= 0.0 and share < 1.0  # at a whole step: what a longer delay does
        share = 1.0 if share > 1.0 else (0.0 if share < 0.0 else share)
        u = now_V + share * (before_V - now_V)
        spool_step(
            x,
            S,
            moving,
            numbers,
            u,
            share,
            (before_V - now_V) / h if changes else 0.0,
            d_now,
            d_before,
            gain_y,
            h,
            ka,
            dka,
            om,
            th[ZETA],
        )
        # flows: q1, q2 and their derivatives; direct ones by numbers wait until the pressures move
        middle = x[X] - 0.5 * h * x[XD]  # of the spool within the step
        across = x[P2] - x[P1]
        q1 = th[LEAK] * across - th[LEAK_TANK] * (x[P1] - tank)
        q2 = -th[LEAK] * across
        q1x = q2x = q1_2 = q2_1 = 0.0
        q1_1 = -th[LEAK] - th[LEAK_TANK]
        q2_2 = -th[LEAK]
        q1_2, q2_1 = th[LEAK], th[LEAK]
        if four:
            q1 += th[LEAK_SUPPLY] * (supply - x[P1])
            q2 += th[LEAK_SUPPLY_TOP] * (supply - x[P2]) - th[LEAK_TANK_TOP] * (x[P2] - tank)
            q1_1 -= th[LEAK_SUPPLY]
            q2_2 -= th[LEAK_SUPPLY_TOP] + th[LEAK_TANK_TOP]
        u1 = u1d = u1s = u1b = u1c = u1n = u1k = u1t = u1l = 0.0
        u2 = u2d = u2s = u2b = u2c = u2n = u2k = u2t = u2l = u2r = 0.0
        opening(middle - th[DEAD_UP], s_up, th[TAIL], th[NOTCH], th[BEND], th[BEND2], o)
        if o[0] > 0.0:
            orifice(o[0], supply - x[P1], turbulent, laminar, q)
            q1 += gu * q[0]
            u1, slope = flow * q[0], gu * q[1]
            q1x += slope * o[1]
            u1d, u1s, u1b, u1c = slope * o[1], slope * o[2] * rounds_up, slope * o[3], slope * o[4]
            u1n, u1k = slope * o[5], slope * o[6]
            q1_1 -= gu * q[2]
            u1t, u1l = gu * q[3], gu * q[4]
        if four:
            opening(middle - th[DEAD_UP] - th[SKEW_UP], s_up, th[TAIL], th[NOTCH], th[BEND], th[BEND2], o)
            if o[0] > 0.0:
                orifice(o[0], x[P2] - tank, turbulent, laminar, q)
                behind_line(q, o[0], x[P2] - tank, gu, th[RETURN])
                q2 -= gu * q[0]
                u2, slope = -flow * q[5], -gu * q[1]
                q2x += slope * o[1]
                u2d, u2s, u2b, u2c = slope * o[1], slope * o[2] * rounds_up, slope * o[3], slope * o[4]
                u2n, u2k = slope * o[5], slope * o[6]
                q2_2 -= gu * q[2]
                u2t, u2l, u2r = -gu * q[3], -gu * q[4], -gu * q[6]
        d1 = d1d = d1s = d1r = d2 = d2d = d2s = 0.0
        opening(-middle - th[DEAD_DN], s_dn, th[TAIL], th[NOTCH], th[BEND], th[BEND2], o)
        if o[0] > 0.0:
            orifice(o[0], x[P1] - tank, turbulent, laminar, q)
            behind_line(q, o[0], x[P1] - tank, gd, th[RETURN])
            q1 -= gd * q[0]
            d1, slope = -flow * q[5], -gd * q[1]
            q1x -= slope * o[1]
            d1d, d1s = slope * o[1], slope * o[2] * rounds_dn
            u1b += slope * o[3]
            u1c += slope * o[4]
            u1n += slope * o[5]
            u1k += slope * o[6]
            q1_1 -= gd * q[2]
            u1t -= gd * q[3]
            u1l -= gd * q[4]
            d1r = -gd * q[6]
        if four:
            opening(-middle - th[DEAD_DN] - th[SKEW_DN], s_dn, th[TAIL], th[NOTCH], th[BEND], th[BEND2], o)
            if o[0] > 0.0:
                orifice(o[0], supply - x[P2], turbulent, laminar, q)
                q2 += gd * q[0]
                d2, slope = flow * q[0], gd * q[1]
                q2x -= slope * o[1]
                d2d, d2s = slope * o[1], slope * o[2] * rounds_dn
                u2b += slope * o[3]
                u2c += slope * o[4]
                u2n += slope * o[5]
                u2k += slope * o[6]
                q2_2 -= gd * q[2]
                u2t += gd * q[3]
                u2l += gd * q[4]
        # friction and speed
        v = x[V]
        up = v >= 0.0
        coulomb = COULOMB_UP if up else COULOMB_DN
        static = STATIC_UP if up else STATIC_DN
        viscous = VISCOUS_UP if up else VISCOUS_DN
        fade = exp(-abs(v) / cs)
        g = th[coulomb] + th[static] * fade
        free = 1.0 if g > 0.1 else 0.0
        g = g if g > 0.1 else 0.1
        vr, vr_v, vr_reg = sliding(v, reg)
        den = 1.0 + h * vr * sigma / g
        place = x[Y] - 0.5 * sheet[S_STROKE]
        drive = x[P1] * a1 - x[P2] * a2 - th[HOLD] - th[SPRING] * place - extra - sigma * x[Z] / den
        below = 1.0 + h * (th[viscous] + sigma * h / den) / m
        v1 = (v + h * drive / m) / below
        z = x[Z]
        # v1 = (v + h drive/m)/below: by den: sigma z/den^2 h/m /below + v1 sigma h^2/(m den^2)/below
        hb = h / (m * below)
        v_den = hb * (sigma * z + v1 * sigma * h) / (den * den)
        g_v = -falls * th[static] * fade / cs * (1.0 if up else -1.0) * free
        den_v = h * sigma / g * vr_v - (den - 1.0) / g * g_v
        den_g = -(den - 1.0) / g * free
        v_v = 1.0 / below + v_den * den_v
        v_z = -hb * sigma / den
        z1 = (z + h * v1) / den
        z_den = -z1 / den
        for j in range(n):
            old = Sv[j]
            new = v_v * old + hb * (a1 * S1[j] - a2 * S2[j] - th[SPRING] * Sy[j]) + v_z * Sz[j]
            Sz[j] = (Sz[j] + h * new) / den + z_den * den_v * old
            Sv[j] = new
        if numbers:
            # direct derivatives of v1 and z1 by numbers
            d = v_den * den_g
            Sv[coulomb] += d
            Sz[coulomb] += h * d / den + z_den * den_g
            d *= fade
            Sv[static] += d
            Sz[static] += h * d / den + z_den * den_g * fade
            lncs = th[static] * fade * abs(v) / cs
            d = v_den * den_g * lncs
            Sv[LN_STRIBECK] += d
            Sz[LN_STRIBECK] += h * d / den + z_den * den_g * lncs
            dreg = h * sigma / g * vr_reg / reg
            d = v_den * dreg
            Sv[REG] += d
            Sz[REG] += h * d / den + z_den * dreg
            dgive = (1.0 - den) * sigma
            d = hb * (z + v1 * h) * (sigma / den) * (sigma / den)
            Sv[GIVE] += d
            Sz[GIVE] += h * d / den + z_den * dgive
            d = -hb * v1
            Sv[viscous] += d
            Sz[viscous] += h * d / den
            d = -hb
            Sv[HOLD] += d
            Sz[HOLD] += h * d / den
            d *= place
            Sv[SPRING] += d
            Sz[SPRING] += h * d / den
            # by mass: v1 below = v + h drive/m, m = r MASS; d below = -(below - 1)/MASS; d(drive/m) = -drive/(m MASS)
            d = (v1 * (below - 1.0) - h * drive / m) / (th[MASS] * below)
            Sv[MASS] += d
            Sz[MASS] += h * d / den
        if knot >= 0:
            d = -hb
            Sv[knot] += d
            Sz[knot] += h * d / den
        x[V], x[Z] = v1, z1
        x[Y] += h * v1
        for j in range(n):
            Sy[j] += h * Sv[j]
        # pressures
        column = x[Y] if x[Y] > LEAST_COLUMN_m else LEAST_COLUMN_m
        inside = a1 if x[Y] > LEAST_COLUMN_m else 0.0
        capacity(column * a1 + sheet[S_V1], x[P1], E, th[AIR], c)
        k, net = h / c[0], q1 - a1 * x[V]
        less = k * net / c[0]
        p_y, p_p = -less * c[1] * inside, 1.0 + k * q1_1 - less * c[2]
        if four:
            column = sheet[S_STROKE] - x[Y]
            inside2 = -a2 if column > LEAST_COLUMN_m else 0.0
            column = column if column > LEAST_COLUMN_m else LEAST_COLUMN_m
            c10, c11, c13 = c[0], c[1], c[3]
            capacity(column * a2 + sheet[S_V2], x[P2], E, th[AIR], c)
            k2, net2 = h / c[0], q2 + a2 * x[V]
            less2 = k2 * net2 / c[0]
            r_y, r_p = -less2 * c[1] * inside2, 1.0 + k2 * q2_2 - less2 * c[2]
            for j in range(n):
                one, two = S1[j], S2[j]
                S1[j] = p_p * one + k * q1_2 * two - k * a1 * Sv[j] + p_y * Sy[j]
                S2[j] = r_p * two + k2 * q2_1 * one + k2 * a2 * Sv[j] + r_y * Sy[j]
            for j in range(moving):
                between = Sx[j] - 0.5 * h * Sd[j]
                S1[j] += k * q1x * between
                S2[j] += k2 * q2x * between
            if numbers:
                S2[GAIN_UP] += k2 * u2
                S2[GAIN_DN] += k2 * d2
                S2[DEAD_UP] -= k2 * u2d
                S2[DEAD_DN] -= k2 * d2d
                S2[SKEW_UP] -= k2 * u2d
                S2[SKEW_DN] -= k2 * d2d
                S2[LN_ROUND] += k2 * (u2s + d2s)
                S2[LN_ROUND_RATIO] += k2 * d2s
                S2[RETURN] += k2 * u2r
                S2[LEAK_SUPPLY_TOP] += k2 * (supply - x[P2])
                S2[LEAK_TANK_TOP] -= k2 * (x[P2] - tank)
                S2[BEND] += k2 * u2b
                S2[BEND2] += k2 * u2c
                S2[NOTCH] += k2 * u2n
                S2[TAIL] += k2 * u2k
                S2[LN_TURBULENT] += k2 * turbulent * u2t
                S2[LN_LAMINAR] += k2 * laminar * u2l
                S2[LEAK] -= k2 * across
                S2[SOFT] -= less2 * (column * a2 + sheet[S_V2]) / sheet[S_E]
                S2[AIR] -= less2 * c[3]
            x[P2] += k2 * net2
            if x[P2] < 0.0:
                x[P2] = 0.0
            c[0], c[1], c[3] = c10, c11, c13
        else:
            for j in range(n):
                S1[j] = p_p * S1[j] - k * a1 * Sv[j] + p_y * Sy[j]
            for j in range(moving):
                S1[j] += k * q1x * (Sx[j] - 0.5 * h * Sd[j])
        if numbers:
            S1[GAIN_UP] += k * u1
            S1[GAIN_DN] += k * d1
            S1[DEAD_UP] -= k * u1d
            S1[DEAD_DN] -= k * d1d
            S1[LN_ROUND] += k * (u1s + d1s)
            S1[LN_ROUND_RATIO] += k * d1s
            S1[RETURN] += k * d1r
            if four:
                S1[LEAK_SUPPLY] += k * (supply - x[P1])
            S1[BEND] += k * u1b
            S1[BEND2] += k * u1c
            S1[NOTCH] += k * u1n
            S1[TAIL] += k * u1k
            S1[LN_TURBULENT] += k * turbulent * u1t
            S1[LN_LAMINAR] += k * laminar * u1l
            S1[LEAK] += k * across
            S1[LEAK_TANK] -= k * (x[P1] - tank)
            S1[SOFT] -= less * c[0] / (c[1] * sheet[S_E])
            S1[AIR] -= less * c[3]
        x[P1] += k * net
        if x[P1] < 0.0:
            x[P1] = 0.0
        # pressures as measured
        one, two = x[P1] - x[M1], x[P2] - x[M2]
        x[M1] += kp * one
        if four:
            x[M2] += kp * two
        if numbers:
            for j in range(n):
                T1[j] += kp * (S1[j] - T1[j])
            T1[PRESSURE_LAG] += dkp * one
            if four:
                for j in range(n):
                    T2[j] += kp * (S2[j] - T2[j])
                T2[PRESSURE_LAG] += dkp * two


@compiled
def tick(x, none, th, sheet, now_V, before_V, split, supply, extra, w):
    """`tangent` without derivatives: x is advanced by a tick. none: any array (N_STATES, n), which is left as it is."""
    row = none[Y]
    tangent(x, none, 0, 0, False, th, sheet, now_V, before_V, split, row, row, 0.0, supply, extra, -1, 0.0, 1.0, w)
