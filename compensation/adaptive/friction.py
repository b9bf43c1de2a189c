"""Load and friction, identified from pressure: what a motion needs, above all the pressure step at a reversal.

While the piston moves, the bottom pressure balances load, inertia and friction (Eq. 3.8, 3.9). Over windows,

    P1 - Ps A2/A1 = p0 + p1 a + p2 v+ + p3 v- + p4 sign(v) + p5 y + p6 sign(v) exp(-|v| / v_s)

y is the mean position, a the load demanded: the demanded acceleration, or what the setpoints of all legs ask for
(reference.py). v+ and v- are the velocity of each direction, from displacements. At a reversal all terms but the sign
are continuous: the pressure must step by 2 p4, whatever mass, geometry and viscous friction. p6 is Stribeck friction as
slow windows see it: what is begun with. Reversals tell it better (stribeck.py).
"""

from __future__ import annotations

import math

from ..arithmetic import clip, copy, fill_zero
from ..compiled import compiled
from .chambers import compliance_m_Pa
from .presliding import bristle
from .recursive_least_squares import bound_influence, reset_covariance, scale_covariance, start_fit, update_fit
from .stribeck import MIN_RATE, begin_stribeck, hold_step

MAX_HALF_STEP_MPA = 1.0
DM = 10.0  # [dm/m]
POSITION_PRIOR = 10.0  # standard deviation of p5 [2 kPa/dm]: load hardly depends on position
PAIR_POSITION_PRIOR = (
    1.0  # of a four-way valve: a backlash shifts the phase of a, and p1 goes into p5 (47 of 132 kPa s2/m)
)
TYPICAL_STRIBECK, REVERSALS_NEEDED = 0.5, 5  # P_s over half the step, assumed until so many reversals were seen
MAX_ERRORS = 3.0  # standard errors from which on a window counts for less
PRIOR_UNIT_MPA = 2e-3  # of the priors below: 1 MPa or 1 MPa per (m/s2, dm/s)
NOTHING = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
PRIOR = (500.0, 500.0, 500.0, 500.0, 250.0, POSITION_PRIOR, 15.0)
RESTORED_VARIANCE, RESTORED_REVERSALS = 1e-5, round(1.0 / MIN_RATE)  # of the prior's: 3 %; of Stribeck friction
MAX_LOAD_MISFIT_MPA = 6.6e-3  # rms of a window beyond its noise, up to which the load is the leg's own
PAIR_STEP_MIN_S = 1e-3  # least width of the step on a four-way valve: pressure that leads turns a heavy load early
MIN_WINDOWS = 20  # in each direction, before the fit is used


@compiled
def start_friction(friction, tick_s, stroke_m, window, min_speed_m_s, memory, position_prior=POSITION_PRIOR):
    """Nothing is known but noise and v_s. window: ticks; memory: windows; position_prior: standard deviation of p5.

    Pressures in MPa, lengths in dm inside, so that the numbers are alike."""
    friction.tick_s, friction.stroke_m, friction.window = tick_s, stroke_m, window
    friction.min_speed_m_s, friction.stribeck.tick_s = min_speed_m_s, tick_s
    unit = PRIOR_UNIT_MPA / friction.noise_MPa  # a fit counts in its noise
    friction.position_weight = 1.0 / (unit * position_prior * math.sqrt(memory))
    start_fit(friction.fit, NOTHING, PRIOR, memory, False)
    for i in range(len(PRIOR)):
        friction.fit.scale[i] *= unit
    reset_covariance(friction.fit)


@compiled
def friction_ready(friction):
    """Whether both directions have enough windows."""
    return friction.windows[0] >= MIN_WINDOWS and friction.windows[1] >= MIN_WINDOWS


@compiled
def add_to_friction(friction, position_m, load_Pa, acceleration_m_s2):
    """One tick: position, P1 - Ps A2/A1 and the demanded load, all of now."""
    if friction.count == 0:
        friction.start_m, friction.sum_load, friction.sum_a = position_m, 0.0, 0.0
    friction.sum_load += load_Pa
    friction.sum_a += acceleration_m_s2
    if friction.count == friction.window // 2:
        friction.middle_m = position_m
    friction.count += 1
    if friction.count > friction.window:
        _finish_window(friction, position_m)
        friction.count = 0


@compiled
def _finish_window(friction, position_m):
    v = (position_m - friction.start_m) / (friction.window * friction.tick_s)
    begin, end = ends_m_s(friction, position_m)
    if begin * end < 0.0 or min(abs(begin), abs(end)) < friction.min_speed_m_s:
        return
    near_rest = _mean_share(begin, v, end, friction.stribeck_velocity_m_s)
    n, up, phi = friction.window + 1, 1 if v > 0 else 0, friction.phi
    v *= DM
    phi[0], phi[1], phi[2], phi[3], phi[4] = 1.0, friction.sum_a / n, v * up, v * (1 - up), 2.0 * up - 1.0
    phi[5] = 0.5 * DM * (position_m + friction.start_m - friction.stroke_m)
    phi[6] = phi[4] * near_rest
    load = bound_influence(friction.fit, phi, friction.sum_load / n * 1e-6, friction.noise_MPa, MAX_ERRORS)
    update_fit(friction.fit, phi, load)
    fill_zero(phi)
    phi[5] = friction.position_weight
    update_fit(friction.fit, phi, 0.0)
    friction.windows[up] += 1
    before_Pa = friction.half_step_Pa
    friction.half_step_Pa = 1e6 * clip(friction.fit.theta[4], 0.0, MAX_HALF_STEP_MPA)
    if friction.told:
        hold_step(friction.stribeck, friction.half_step_Pa - before_Pa, 2.0 * friction.half_step_Pa)
    error_Pa = 1e6 * math.sqrt(max(friction.fit.residual, friction.noise_MPa**2) * friction.fit.covariance[6, 6])
    begin_stribeck(friction.stribeck, 1e6 * friction.fit.theta[6], error_Pa, TYPICAL_STRIBECK * friction.half_step_Pa)


@compiled
def _mean_share(begin_m_s, middle_m_s, end_m_s, over_m_s):
    """Mean Stribeck share of a window, by Simpson's rule."""
    middle = stribeck_share(middle_m_s, over_m_s)
    return (stribeck_share(begin_m_s, over_m_s) + 4.0 * middle + stribeck_share(end_m_s, over_m_s)) / 6.0


@compiled
def ends_m_s(friction, position_m):
    """Speeds at both ends of the window that ends here, from its halves; of two signs where the piston turned in it."""
    half = friction.window // 2
    first = (friction.middle_m - friction.start_m) / (half * friction.tick_s)
    last = (position_m - friction.middle_m) / ((friction.window - half) * friction.tick_s)
    return 1.5 * first - 0.5 * last, 1.5 * last - 0.5 * first


@compiled
def smooth_pressure_Pa(friction, position_m, velocity_m_s, acceleration_m_s2):
    """The fit without its step [Pa]."""
    t = friction.fit.theta
    v = DM * velocity_m_s
    y = DM * position_m - 0.5 * DM * friction.stroke_m
    return 1e6 * (t[0] + t[1] * acceleration_m_s2 + v * (t[2] if v > 0 else t[3]) + t[5] * y)


@compiled
def inertia_Pa(friction):
    """p1: pressure for an acceleration of 1 m/s2."""
    return 1e6 * max(friction.fit.theta[1], 5e-3)


@compiled
def step_acceleration_m_s2(friction):
    """Acceleration that the friction step gives the load while the pressure stands still."""
    return 2 * (friction.half_step_Pa + friction.stribeck.pressure_Pa) / inertia_Pa(friction)


@compiled
def resonance_of_load_Hz(friction, settings):
    """The load on the oil below a piston at mid-stroke: 1 / (2 pi sqrt(p1 V / (E A1))). 0 where it is not known: of a
    platform in several degrees of freedom at once a leg's load is not its own (p1 of -0.3 to 0.5 MPa s2/m, misfit of
    13 to 28 kPa against 1 to 4)."""
    if not friction_ready(friction) or friction.fit.residual > MAX_LOAD_MISFIT_MPA**2 + friction.noise_MPa**2:
        return 0.0
    compliance = compliance_m_Pa(settings, 0.5 * settings.stroke_m)
    return 1.0 / (2.0 * math.pi * math.sqrt(compliance * inertia_Pa(friction)))


@compiled
def viscous_decay_1_s(friction):
    """Viscous friction over inertia."""
    return 1e7 * max(min(friction.fit.theta[2], friction.fit.theta[3]), 0.0) / inertia_Pa(friction)


@compiled
def resonance_growth_1_s(friction):
    """Growth rate of the hydraulic resonance near rest, where friction falls with speed."""
    viscous = 1e7 * min(friction.fit.theta[2], friction.fit.theta[3])
    stribeck = friction.stribeck.pressure_Pa
    if friction.stribeck.reversals < REVERSALS_NEEDED and stribeck < TYPICAL_STRIBECK * friction.half_step_Pa:
        stribeck = TYPICAL_STRIBECK * friction.half_step_Pa
    return 0.5 * (stribeck / friction.stribeck_velocity_m_s - viscous) / inertia_Pa(friction)


@compiled
def keep_friction(friction, known):
    """What was identified, in numbers."""
    copy(friction.fit.theta[:6], known.theta_MPa)
    known.windows[0], known.windows[1] = friction.windows[0], friction.windows[1]
    known.half_step_Pa, known.stribeck_Pa = friction.half_step_Pa, friction.stribeck.pressure_Pa


@compiled
def restore_friction(friction, known):
    """Start with what was identified before."""
    copy(known.theta_MPa, friction.fit.theta)
    friction.fit.theta[6] = 1e-6 * known.stribeck_Pa
    friction.windows[0], friction.windows[1] = int(known.windows[0]), int(known.windows[1])
    if friction_ready(friction):
        scale_covariance(friction.fit, RESTORED_VARIANCE)
        friction.stribeck.reversals = RESTORED_REVERSALS
    friction.half_step_Pa, friction.stribeck.pressure_Pa = known.half_step_Pa, known.stribeck_Pa


@compiled
def stribeck_share(velocity_m_s, over_m_s):
    """Share of the Stribeck pressure at a velocity, 1 at rest; over_m_s: velocity over which it falls."""
    speed = abs(velocity_m_s)
    return math.exp(-speed / over_m_s) if speed < 4 * over_m_s else 0.0


@compiled
def demanded_pressure(reference, friction, weight, settings):
    """P1 - Ps A2/A1 [Pa] that the reference needs, its step at a reversal, the signed share of the Stribeck
    pressure in it, and the sign that friction goes to.

    weight: of friction. Its step at a reversal is spread as the settings say.
    """
    if weight == 0.0:
        return 0.0, 0.0, 0.0, 0.0
    v, a = reference.velocity_m_s, reference.acceleration_m_s2
    sign = 1.0 if v > 0.0 else -1.0
    if abs(v) < abs(a) * settings.step_max_s + settings.presliding_m_s:
        least_s = PAIR_STEP_MIN_S if settings.rod_ratio > 0.0 else settings.step_min_s
        width_s = clip(step_acceleration_m_s2(friction) / settings.jerk_m_s3, least_s, settings.step_max_s)
        x = v / (abs(a) * width_s + settings.presliding_m_s)
        if -1.0 < x < 1.0:
            sign = x * (2.0 - abs(x))
    p = friction.presliding
    p.bristle = bristle(p.bristle, sign, abs(v) * settings.tick_s, p.length_m)
    share = p.bristle * stribeck_share(v, settings.stribeck_velocity_m_s)
    step = p.bristle * friction.half_step_Pa + share * friction.stribeck.pressure_Pa
    smooth_Pa = smooth_pressure_Pa(friction, reference.position_m, v, reference.load_m_s2)
    return weight * (smooth_Pa + step), step, share, sign


@compiled
def missing_step_Pa(reference, friction, settings, step_Pa):
    """What of friction's step is still to come at the reversal that the reference is in; 0 between reversals."""
    v, a = reference.velocity_m_s, reference.acceleration_m_s2
    if abs(v) > abs(a) * settings.tick_s + settings.presliding_m_s:
        return 0.0
    return math.copysign(friction.half_step_Pa + friction.stribeck.pressure_Pa, a) - step_Pa
