"""A second, independent plant: the report's equations (Eq. 3.2-3.9) and more, by RK4. Imports nothing of hexsim.

State of leg i (6 numbers): P1, spool x, spool rate, bristle z, rod-side pressure P2, slow memory m. Then the supply
pressure, a payload's travel and rate, and the motion: bench (y, v), hexapod (p[3], quaternion[4], p'[3], w[3] in the
platform frame).
"""

import math

import numpy as np
from numba import njit

PER_LEG = 6
ATMOSPHERE = 1.01325e5

# declared; then effects with a name in the library; effects without one; sensors of the leg
FIELDS_LEG = """
area1 area2 stroke pipe_volume density modulus discharge gradient_supply gradient_tank overlap_supply
overlap_tank rounding spool_per_volt travel viscous_out viscous_in coulomb_out coulomb_in static_out static_in
stribeck sharpness tank_pressure
return_resistance leak_supply leak_tank clearance clearance_length null_offset null_drift spool_frequency
spool_damping spool_rate hysteresis valve_delay_ms air hose bristle_stiffness bristle_damping seal ripple
ripple_length spring force tone tone_frequency longer
cubic gain_position gain_voltage gain_pressure stick stick_place stick_width cooling rod_air line_inertia
line_loss memory
warm_up warm_up_s wear wear_place wear_width hardening laminar laminar_law viscosity
position_gain position_delay_ms position_lag_ms position_play scale_error scale_length pressure_gain pressure_offset pressure_delay_ms
pressure_lag_ms hum hum_frequency
"""
FIELDS_RIG = """
n_legs hexapod gravity mass incline supply_pressure line_resistance line_capacity pump_flow gas_volume
gas_exponent payload_mass payload_omega payload_damping payload_gap payload_stop inertia_x inertia_y inertia_z
com_x com_y com_z floor floor_frequency jitter_s acceleration_gain acceleration_offset acceleration_delay_ms
supply_gain neutral_length gain_V_per_m pump_ripple pump_frequency imu_turn_y
"""
LEG_TYPE = np.dtype([(name, "f8") for name in FIELDS_LEG.split()])
RIG_TYPE = np.dtype([(name, "f8") for name in FIELDS_RIG.split()])

fast = njit(cache=True, error_model="numpy", _nrt=False)  # makes no arrays, so that no owner need be counted


@fast
def edge(x, overlap, rounding):
    """Opening of one edge [m], a soft corner of width `rounding`."""
    s = (x - overlap) / rounding
    if s > 35.0:
        return x - overlap
    return rounding * math.log(1.0 + math.exp(max(s, -600.0)))


@fast
def root(dp):
    """sqrt(|dp|) sign(dp), rounded within 10 kPa [sqrt(Pa)]."""
    return dp / (dp * dp + 1.0e8) ** 0.25


@fast
def slowly(leg, opening, dp, turbulent):
    """Flow of a slot [m3/s] whose root law gives `turbulent`, below the Reynolds number leg.laminar by viscosity.

    Hydraulic diameter 2 opening. leg.laminar_law: 0 the root law is bent, 1 C_d = C min(sqrt(Re/Re_cr), 1) as Merritt draws
    it, 2 in the form of Wu, Burton and Schoenau 2002, C (1 + a exp(-s) + b exp(-2 s)), s ~ sqrt(Re), a + b = -1,
    which overshoots, 3 the pressure drops of both laws add up, which is an overlap at wide openings.
    """
    if leg.laminar == 0.0 or opening == 0.0:
        return turbulent
    jet = leg.laminar * leg.viscosity / (2.0 * opening * leg.discharge)  # sqrt(2 dp/rho) where the two laws meet
    bend = 0.5 * leg.density * jet * jet / max(abs(dp), 1.0)  # their pressure drop, in units of the present one
    if leg.laminar_law == 1.0:
        return turbulent * min(1.0 / math.sqrt(bend), 1.0)
    if leg.laminar_law == 2.0:
        low, high = 0.0, 2.0  # of C_d/C, whose Reynolds number is C_d/C / sqrt(bend) times Re_cr
        for _ in range(40):
            share = 0.5 * (low + high)
            fade = math.exp(-math.sqrt(share / math.sqrt(bend)) / 3.07)
            if 1.0 + 1.07 * fade - 2.07 * fade * fade - share > 0.0:
                low = share
            else:
                high = share
        return turbulent * share
    if leg.laminar_law == 3.0:
        half = 0.5 * math.sqrt(bend)  # z^2 + sqrt(bend) z = 1
        return turbulent * (math.sqrt(half * half + 1.0) - half)
    return turbulent / (1.0 + bend * bend) ** 0.25


@fast
def valve_flows(leg, x, volts, y, P1, Ps):
    """(supply edge, tank edge) [m3/s], Eq. 3.3-3.4, with every effect on the valve's edges."""
    scale = leg.discharge * math.sqrt(2.0 / leg.density)
    scale *= (1.0 + leg.gain_position * (2.0 * y / leg.stroke - 1.0)) * (1.0 + leg.gain_voltage * abs(volts))
    in_dp, out_dp = Ps - P1, P1 - leg.tank_pressure
    open_in = leg.gradient_supply * edge(x, leg.overlap_supply, leg.rounding)
    open_out = leg.gradient_tank * edge(-x, leg.overlap_tank, leg.rounding)
    through = slowly(leg, edge(x, leg.overlap_supply, leg.rounding), in_dp, open_in * root(in_dp))
    into = scale * through * (1.0 + leg.gain_pressure * (in_dp / 3.5e6 - 1.0))
    k = scale * open_out * (1.0 + leg.gain_pressure * (out_dp / 3.5e6 - 1.0))
    if leg.return_resistance > 0.0 and out_dp > 0.0:  # the tank line backs up: k sqrt(dp - R q) = q
        b = k * k * leg.return_resistance
        out = 0.5 * (-b + math.sqrt(b * b + 4.0 * k * k * out_dp))
    else:
        out = slowly(leg, edge(-x, leg.overlap_tank, leg.rounding), out_dp, k * root(out_dp))
    if leg.clearance > 0.0:  # Poiseuille over what is left of the land
        into += leg.clearance * in_dp * leg.clearance_length / (leg.clearance_length + max(leg.overlap_supply - x, 0.0))
        out += leg.clearance * out_dp * leg.clearance_length / (leg.clearance_length + max(leg.overlap_tank + x, 0.0))
    return into, out


@fast
def stiffness_of_oil(leg, P):
    """Bulk modulus [Pa] of oil with a share `air` of free air at one atmosphere: as warm as the oil, rippling adiabatically."""
    if leg.air == 0.0:
        return leg.modulus
    p = max(P + ATMOSPHERE, 2.0e4)
    bubbles = leg.air * ATMOSPHERE / p
    return (1.0 + bubbles) / (1.0 / leg.modulus + bubbles / (1.4 * p))


@fast
def friction(leg, y, v, P1, z, memory, t):
    """(force against the motion [N], dz/dt)."""
    if v >= 0.0:
        viscous, coulomb, static = leg.viscous_out, leg.coulomb_out, leg.static_out
    else:
        viscous, coulomb, static = leg.viscous_in, leg.coulomb_in, leg.static_in
    coulomb += leg.seal * max(P1, 0.0)
    if leg.ripple != 0.0:
        coulomb += leg.ripple * math.sin(2.0 * math.pi * y / leg.ripple_length)
    if leg.stick != 0.0:
        coulomb += leg.stick * math.exp(-(((y - leg.stick_place) / leg.stick_width) ** 2))
    coulomb *= 1.0 + leg.memory * memory / 0.05
    level = max(coulomb, 0.0) + static * math.exp(-abs(v) / leg.stribeck)
    viscous *= 1.0 - leg.cooling * t
    if leg.warm_up != 0.0:  # oil and seals warm up: all friction fades
        fade = 1.0 - leg.warm_up * (1.0 - math.exp(-t / leg.warm_up_s))
        viscous, level = viscous * fade, level * fade
    if leg.bristle_stiffness > 0.0:
        rate = v - leg.bristle_stiffness * abs(v) / level * z
        return viscous * v + leg.bristle_stiffness * z + leg.bristle_damping * rate + leg.cubic * v**3, rate
    return viscous * v + level * math.tanh(v / leg.sharpness) + leg.cubic * v**3, 0.0


@fast
def leg_step(leg, s, y, v, volts, Ps, t, ds):
    """Rates of one leg's states into ds; returns (force on load [N], flow from supply, flow to tank)."""
    P1, x, x_rate, z, P2, memory = s[0], s[1], s[2], s[3], s[4], s[5]
    asked = (volts - leg.null_offset - leg.null_drift * t) * leg.spool_per_volt
    asked = min(max(asked, -leg.travel), leg.travel)
    ds[1] = 0.0
    ds[2] = 0.0
    if leg.spool_frequency > 0.0:
        w = 2.0 * math.pi * leg.spool_frequency
        ds[1] = x_rate
        ds[2] = w * w * (asked - x) - 2.0 * leg.spool_damping * w * x_rate
    elif leg.spool_rate > 0.0:
        ds[1] = min(max((asked - x) * 3000.0, -leg.spool_rate), leg.spool_rate)
    else:
        x = asked
    into, out = valve_flows(leg, x, volts, y, P1, Ps)
    seep = leg.leak_supply * (Ps - P1)
    if leg.wear > 0.0:  # the bore is worn at one place: its seal lets the rod side's oil through there
        seep += leg.wear * (Ps - P1) * math.exp(-(((y - leg.wear_place) / leg.wear_width) ** 2))
    net = into + seep - out - leg.leak_tank * (P1 - leg.tank_pressure) - leg.area1 * v
    ds[0] = net / ((leg.area1 * y + leg.pipe_volume) / stiffness_of_oil(leg, P1) + leg.hose)
    rub, ds[3] = friction(leg, y, v, P1, z, memory, t)
    ds[5] = (abs(v) - memory) / 0.4
    ds[4] = 0.0
    back = Ps
    if leg.rod_air > 0.0:  # air pocket behind a narrow port, dp = 4e13 q |q|
        ds[4] = (leg.area2 * v - root(P2 - Ps) / 6.3e6) / (leg.rod_air / (1.4 * (P2 + ATMOSPHERE)) + 4.0e-14)
        back = P2
    elif leg.line_loss > 0.0 and v > 0.0:  # a check valve takes the other direction
        back = Ps + leg.line_loss * (leg.area2 * v) ** 2
    force = P1 * leg.area1 - back * leg.area2 - rub
    off = y - 0.5 * leg.stroke
    force += leg.force - leg.spring * off - leg.hardening * off**3
    if leg.tone != 0.0:
        force += leg.tone * math.sin(2.0 * math.pi * leg.tone_frequency * t)
    return force, into + seep - leg.area2 * v, out


@fast
def supply_rate(rig, Ps, demand):
    """dPs/dt [Pa/s]: ideal, pump line with accumulator, limited pump, or gas accumulator."""
    if rig.line_resistance == 0.0:
        return 0.0
    pump = (rig.supply_pressure - Ps) / rig.line_resistance
    if rig.pump_flow > 0.0:
        pump = min(pump, rig.pump_flow)
    capacity = rig.line_capacity
    if rig.gas_volume > 0.0:  # gas volume at the nominal pressure, polytropic
        p, p0 = Ps + ATMOSPHERE, rig.supply_pressure + ATMOSPHERE
        capacity = rig.gas_volume * (p0 / p) ** (1.0 / rig.gas_exponent) / (rig.gas_exponent * p)
    return (pump - demand) / capacity


@fast
def pump_wave(rig, t):
    """What the pump's pistons add to the supply pressure [Pa]."""
    return rig.pump_ripple * math.sin(2.0 * math.pi * rig.pump_frequency * t)


@fast
def payload_force(rig, q, q_rate):
    """Force [N] of the payload's suspension on the machine at travel q: soft spring, then stops."""
    force = rig.payload_mass * (rig.payload_omega**2 * q + 2.0 * rig.payload_damping * rig.payload_omega * q_rate)
    if rig.payload_gap > 0.0:
        beyond = max(abs(q) - rig.payload_gap, 0.0)
        if beyond > 0.0:
            force += math.copysign(rig.payload_stop * beyond, q) + 60.0 * q_rate
    return force


@fast
def bench_rates(rig, legs, X, volts, t, dX, a_out):
    """Right-hand side of the single leg; a_out[0] = absolute acceleration of the load along the leg [m/s2]."""
    Ps, q, q_rate, y, v = X[6] + pump_wave(rig, t), X[7], X[8], X[9], X[10]
    leg = legs[0]
    force, demand, _ = leg_step(leg, X[:6], y, v, volts[0], Ps, t, dX[:6])
    dX[6] = supply_rate(rig, X[6], demand)
    ride = payload_force(rig, q, q_rate) if rig.payload_mass > 0.0 else 0.0
    mass = rig.mass + (leg.line_inertia * leg.area2**2 if v > 0.0 else 0.0)
    ground = rig.floor * math.sin(2.0 * math.pi * rig.floor_frequency * t)
    a = (force - (rig.mass + rig.payload_mass) * rig.gravity * math.cos(rig.incline) + ride) / mass
    dX[7] = q_rate
    dX[8] = (-ride / rig.payload_mass - a) if rig.payload_mass > 0.0 else 0.0
    dX[9] = v
    dX[10] = a - ground
    a_out[0] = a


@fast
def rotation(q, R):
    """Rotation matrix platform -> world of the quaternion (w, x, y, z), normalised on the way."""
    n = math.sqrt(q[0] ** 2 + q[1] ** 2 + q[2] ** 2 + q[3] ** 2)
    w, x, y, z = q[0] / n, q[1] / n, q[2] / n, q[3] / n
    R[0, 0], R[0, 1], R[0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    R[1, 0], R[1, 1], R[1, 2] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    R[2, 0], R[2, 1], R[2, 2] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)


@fast
def cross(a, b, out):
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@fast
def leg_lengths(rig, legs, base, joints, p, R, y):
    """Piston positions y (6,) [m] of a pose."""
    for i in range(6):
        total = 0.0
        for k in range(3):
            d = p[k] - base[i, k] + R[k, 0] * joints[i, 0] + R[k, 1] * joints[i, 1] + R[k, 2] * joints[i, 2]
            total += d * d
        y[i] = math.sqrt(total) - rig.neutral_length - legs[i].longer + 0.5 * legs[i].stroke


@fast
def hexapod_rates(rig, legs, base, joints, X, volts, t, dX, a_out, y_out, W):
    """Right-hand side of the platform on legs. a_out (6,): accelerometers; y_out (6,): pistons; W (8, 3) scratch."""
    M = 6 * PER_LEG
    Ps, ride_q, ride_rate = X[M], X[M + 1], X[M + 2]
    p, quat, speed, w = X[M + 3 : M + 6], X[M + 6 : M + 10], X[M + 10 : M + 13], X[M + 13 : M + 16]
    R = W[0:3]
    rotation(quat, R)
    F, T, turn, u = W[3], W[4], W[6], W[7]
    F[:] = 0.0
    T[:] = 0.0  # torque about the joint centre, platform frame
    demand = 0.0
    for i in range(6):
        cross(w, joints[i], turn)
        length, v = 0.0, 0.0
        for k in range(3):
            u[k] = p[k] - base[i, k] + R[k, 0] * joints[i, 0] + R[k, 1] * joints[i, 1] + R[k, 2] * joints[i, 2]
            length += u[k] * u[k]
        length = math.sqrt(length)
        for k in range(3):
            u[k] /= length
            v += u[k] * (speed[k] + R[k, 0] * turn[0] + R[k, 1] * turn[1] + R[k, 2] * turn[2])
        y = length - rig.neutral_length - legs[i].longer + 0.5 * legs[i].stroke
        y_out[i] = y
        j = i * PER_LEG
        f, q, _ = leg_step(legs[i], X[j : j + 6], y, v, volts[i], Ps, t, dX[j : j + 6])
        demand += q
        for k in range(3):
            F[k] += f * u[k]
        local = (
            R[0, 0] * u[0] + R[1, 0] * u[1] + R[2, 0] * u[2],
            R[0, 1] * u[0] + R[1, 1] * u[1] + R[2, 1] * u[2],
            R[0, 2] * u[0] + R[1, 2] * u[1] + R[2, 2] * u[2],
        )
        T[0] += f * (joints[i, 1] * local[2] - joints[i, 2] * local[1])
        T[1] += f * (joints[i, 2] * local[0] - joints[i, 0] * local[2])
        T[2] += f * (joints[i, 0] * local[1] - joints[i, 1] * local[0])
    ride = payload_force(rig, ride_q, ride_rate) if rig.payload_mass > 0.0 else 0.0
    dX[M] = supply_rate(rig, Ps, demand)
    # force in the platform frame, torque about the centre of mass, Euler, and back to the joint centre
    c = (rig.com_x, rig.com_y, rig.com_z)
    f0 = R[0, 0] * F[0] + R[1, 0] * F[1] + R[2, 0] * F[2]
    f1 = R[0, 1] * F[0] + R[1, 1] * F[1] + R[2, 1] * F[2]
    f2 = R[0, 2] * F[0] + R[1, 2] * F[1] + R[2, 2] * F[2]
    f2 += ride - rig.payload_mass * rig.gravity  # its suspension stands on the platform, along its vertical axis
    I0, I1, I2 = rig.inertia_x, rig.inertia_y, rig.inertia_z
    a0 = (T[0] - (c[1] * f2 - c[2] * f1) - (I2 - I1) * w[1] * w[2]) / I0
    a1 = (T[1] - (c[2] * f0 - c[0] * f2) - (I0 - I2) * w[2] * w[0]) / I1
    a2 = (T[2] - (c[0] * f1 - c[1] * f0) - (I1 - I0) * w[0] * w[1]) / I2
    wc0, wc1, wc2 = w[1] * c[2] - w[2] * c[1], w[2] * c[0] - w[0] * c[2], w[0] * c[1] - w[1] * c[0]
    level = rig.mass + rig.payload_mass  # a suspended payload rides along sideways
    b0 = f0 / level - (a1 * c[2] - a2 * c[1]) - (w[1] * wc2 - w[2] * wc1)
    b1 = f1 / level - (a2 * c[0] - a0 * c[2]) - (w[2] * wc0 - w[0] * wc2)
    b2 = f2 / rig.mass - (a0 * c[1] - a1 * c[0]) - (w[0] * wc1 - w[1] * wc0)
    g = rig.gravity
    a_out[0], a_out[1], a_out[2] = b0 - R[2, 0] * g, b1 - R[2, 1] * g, b2 - R[2, 2] * g
    a_out[3], a_out[4], a_out[5] = a0, a1, a2
    ground = rig.floor * math.sin(2.0 * math.pi * rig.floor_frequency * t)
    for k in range(3):
        dX[M + 3 + k] = speed[k]
        dX[M + 10 + k] = R[k, 0] * a_out[0] + R[k, 1] * a_out[1] + R[k, 2] * a_out[2]
    dX[M + 12] -= ground
    dX[M + 1] = ride_rate
    dX[M + 2] = (-ride / rig.payload_mass - f2 / rig.mass + g) if rig.payload_mass > 0.0 else 0.0
    dX[M + 6] = 0.5 * (-quat[1] * w[0] - quat[2] * w[1] - quat[3] * w[2])
    dX[M + 7] = 0.5 * (quat[0] * w[0] + quat[2] * w[2] - quat[3] * w[1])
    dX[M + 8] = 0.5 * (quat[0] * w[1] - quat[1] * w[2] + quat[3] * w[0])
    dX[M + 9] = 0.5 * (quat[0] * w[2] + quat[1] * w[1] - quat[2] * w[0])
    dX[M + 13], dX[M + 14], dX[M + 15] = a0, a1, a2


@fast
def towards(X, h, slope, out):
    """out = X + h slope."""
    for i in range(X.shape[0]):
        out[i] = X[i] + h * slope[i]


@njit(cache=True, error_model="numpy")
def integrate(rig_box, legs, base, joints, X, reference, late_s, substeps):
    """Closed loop over len(reference) milliseconds. Controller every 2 ms on the true piston position, zero-order hold.

    reference (n, legs) [m] at 1 kHz; late_s (n,): the valve sees an update so much later. Returns y, volts, P1
    (n, legs), Ps (n,), acceleration (n, 1 or 6), all free of noise.
    """
    rig = rig_box[0]
    n, n_legs = reference.shape
    size = X.shape[0]
    hexapod = rig.hexapod > 0.0
    n_acc = 6 if hexapod else 1
    y_log, u_log, P_log = np.zeros((n, n_legs)), np.zeros((n, n_legs)), np.zeros((n, n_legs))
    S_log, a_log = np.zeros(n), np.zeros((n, n_acc))
    k1, k2, k3, k4, Y = np.zeros(size), np.zeros(size), np.zeros(size), np.zeros(size), np.zeros(size)
    W, acc, spare, y = np.zeros((8, 3)), np.zeros(6), np.zeros(6), np.zeros(6)
    asked, spool, before = np.zeros(n_legs), np.zeros(n_legs), np.zeros(n_legs)
    h = 1e-3 / substeps
    for k in range(n):
        t = k * 1e-3
        if hexapod:
            hexapod_rates(rig, legs, base, joints, X, spool, t, k1, acc, y, W)
        else:
            y[0] = X[9]
        if k % 2 == 0:
            for i in range(n_legs):
                asked[i] = min(max(rig.gain_V_per_m * (reference[k, i] - y[i]), -10.0), 10.0)
        for i in range(n_legs):
            u_log[k, i] = asked[i]
            late = u_log[max(k - int(legs[i].valve_delay_ms), 0), i]
            before[i] = spool[i]
            spool[i] = min(max(spool[i], late - legs[i].hysteresis), late + legs[i].hysteresis)  # play
        hold = int(late_s[k] / h)
        for step in range(substeps):
            volts = before if step < hold else spool
            t = k * 1e-3 + step * h
            if hexapod:
                hexapod_rates(rig, legs, base, joints, X, volts, t, k1, spare if step > 0 else acc, y, W)
                towards(X, 0.5 * h, k1, Y)
                hexapod_rates(rig, legs, base, joints, Y, volts, t + 0.5 * h, k2, spare, spare, W)
                towards(X, 0.5 * h, k2, Y)
                hexapod_rates(rig, legs, base, joints, Y, volts, t + 0.5 * h, k3, spare, spare, W)
                towards(X, h, k3, Y)
                hexapod_rates(rig, legs, base, joints, Y, volts, t + h, k4, spare, spare, W)
            else:
                bench_rates(rig, legs, X, volts, t, k1, spare if step > 0 else acc)
                towards(X, 0.5 * h, k1, Y)
                bench_rates(rig, legs, Y, volts, t + 0.5 * h, k2, spare)
                towards(X, 0.5 * h, k2, Y)
                bench_rates(rig, legs, Y, volts, t + 0.5 * h, k3, spare)
                towards(X, h, k3, Y)
                bench_rates(rig, legs, Y, volts, t + h, k4, spare)
            if step == 0:
                for i in range(n_legs):
                    y_log[k, i] = y[i]
                    P_log[k, i] = X[i * PER_LEG]
                S_log[k] = X[n_legs * PER_LEG] + pump_wave(rig, k * 1e-3)
                for j in range(n_acc):
                    a_log[k, j] = acc[j]
            for i in range(size):
                X[i] += h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i])
    return y_log, u_log, P_log, S_log, a_log
