"""Legs under their load in closed loop, compiled: the simulation that fits ask for thousands of times.

u_k = K (s_k - y_m)  every 1/rate seconds, held, after the computing delay; then delay and hysteresis of the valve

The real loop reads the position with its noise, which moves the machine. Logged volts U_k that show this noise act in the model, too, but
for what they slowly differ by from its own, so that its loop holds it to its setpoint: u_k + c (1 - L)(U_k - u_k), L a low-pass, c the
controller's volts_share.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from hexsim.compiled import compiled
from hexsim.hydraulics import chamber, valve
from hexsim.hydraulics.parameters import P
from hexsim.hydraulics.steps import near_standstill
from hexsim.mechanics.rigid_body import cross, triple
from hexsim.signals.lag import lag_weights
from hexsim.signals.ripple import rippled
from hexsim.tracing.simulation.motion import (
    LEG_P1,
    LEG_STATES,
    LEGS,
    N_PLATFORM,
    OMEGA,
    SUPPLY,
    integrate,
    rates,
    rod_side_pressure,
    steps_of_sample,
    write_leg_motion,
)
from hexsim.tracing.simulation.rig import LOGGED_VOLTS, OWN_TRANSDUCER, Rig

DIVERGENCE_LIMIT = 1e3  # [m], [m/s], [rad/s] a load beyond it has diverged


class Inputs(NamedTuple):
    """What drives the simulation: (n_legs, n) setpoints, logged volts and positions.

    near_rest (n,): where any leg is near standstill by its measured position: there steps follow the ring of a reversal, so that
    variants of a model step alike and their differences are smooth. What friction's sign asks for goes by the model's own speed.
    rate_Hz: of the samples. first_tick: sample of the controller's first tick. start_s: time that the run lasts already.
    slow_share: of L, a sample.
    """

    setpoint: np.ndarray
    volts: np.ndarray
    position: np.ndarray
    near_rest: np.ndarray
    rate_Hz: float
    first_tick: int
    start_s: float
    slow_share: float


SIGNALS = ("setpoint", "volts", "position", "near_rest")  # of the inputs, sample by sample


class Room(NamedTuple):
    """Arrays that the simulation works in. state (n_states,); slopes: four, and a state to try; y, v, v a sample ago, held volts
    and how far a valve's two plays are apart (n_legs,). late: whole samples and rests of the valves' delays, volts of the sample before
    and those that the spools have now (n_legs,). slow (n_legs,): what logged volts and the model's slowly differ by.

    positions, pressures of the bottom chambers and of the rod sides, volts, volts before the computing delay (n_legs, n),
    accelerations (n_axes, n): what happened, for sensors and valves with a delay.  sharp (n_rows,): what the sensors of `run`
    would show a sample ago without their filters; memory (n_rows, n_sections, 2) of these.
    """

    state: np.ndarray
    slopes: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]
    legs: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]
    late: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
    slow: np.ndarray
    positions: np.ndarray
    pressures: np.ndarray
    tops: np.ndarray
    volts: np.ndarray
    asked: np.ndarray
    accelerations: np.ndarray
    sharp: np.ndarray
    memory: np.ndarray


def room_for(rig: Rig, inputs: Inputs, start: np.ndarray) -> Room:
    """Room for a simulation from a state."""
    n_legs, n_axes, n = len(rig.legs), len(rig.sensors.acceleration), inputs.setpoint.shape[1]
    n_sections = max(len(own) for own in rig.sensors.filters)
    late = valve.delay_in_ticks(rig.legs[:, P.VALVE_DELAY], 1.0 / inputs.rate_Hz)
    s, y = np.zeros_like, np.zeros(n_legs)
    bottom, top = np.empty((2, n_legs, n))
    moved, volts, asked = np.empty((3, n_legs, n))
    slopes = (s(start), s(start), s(start), s(start), s(start))
    rows = 4 * n_legs + 1 + n_axes
    return Room(
        start.copy(), slopes, (y, s(y), s(y), s(y), s(y)), (*late, s(y), s(y)), s(y), moved, bottom, top, volts, asked,
        np.empty((n_axes, n)), np.zeros(rows), np.zeros((rows, n_sections, 2)),
    )  # fmt: skip


@compiled
def delayed(history, i, delay):
    """history at sample i - delay (delay in samples, fractional)."""
    place = i - delay
    if place <= 0.0:
        return history[0]
    k = int(place)
    share = place - k
    if share == 0.0 or k + 1 > i:
        return history[k]
    return (1.0 - share) * history[k] + share * history[k + 1]


@compiled
def shown(history, i, sensor, rate, before):
    """What a sensor (gain, offset, delay [s], lag [s]) shows at sample i of what happened, (n,) up to i.

    before: what it showed at the sample before.
    """
    late = sensor[2] * rate
    value = sensor[0] * delayed(history, i, late) + sensor[1]
    if sensor[3] == 0.0 or i == 0:
        return value
    p, b0, b1 = lag_weights(sensor[3], 1.0 / rate)
    return p * before + b0 * value + b1 * (sensor[0] * delayed(history, i - 1, late) + sensor[1])


@compiled
def smoothed(sections, memory, value, begins):
    """The next value behind second-order sections (direct form II transposed), which begin at rest at the first one."""
    for k in range(sections.shape[0]):
        b0, b1, b2, a1, a2 = sections[k, 0], sections[k, 1], sections[k, 2], sections[k, 4], sections[k, 5]
        if begins:
            rest = value * (b0 + b1 + b2) / (1.0 + a1 + a2)
            memory[k, 1] = b2 * value - a2 * rest
            memory[k, 0] = b1 * value - a1 * rest + memory[k, 1]
        out = b0 * value + memory[k, 0]
        memory[k, 0] = b1 * value - a1 * out + memory[k, 1]
        memory[k, 1] = b2 * value - a2 * out
        value = out
    return value


@compiled
def asked_volts(controller, inputs, j, i, position):
    """Volts of leg j's loop at sample i for the position that it reads."""
    if controller.feedback == LOGGED_VOLTS:
        # 0.3 of the gain: with all of it the noise of the logged position rings the oil, with less rounded volts let it drift
        volts = inputs.volts[j, i] + 0.3 * controller.gain_V_per_m[j] * (inputs.position[j, i] - position)
    else:
        volts = controller.gain_V_per_m[j] * (inputs.setpoint[j, i] - position)
    return min(max(volts, -controller.limit_V[j]), controller.limit_V[j])


@compiled
def computed(asked, i, delay_ticks, every):
    """Volts at a tick, sample i: those of so many ticks ago, between two of them a share of each. asked (n,) up to i."""
    whole = int(delay_ticks)
    part, last = delay_ticks - whole, max(i - whole * every, 0)
    return (1.0 - part) * asked[last] + part * asked[max(last - every, 0)] if part > 0.0 else asked[last]


@compiled
def acting_volts(volts_share, inputs, j, i, computed_V, slow):
    """Volts that leg j's valve gets at sample i: the loop's, and a share of what logged ones quickly differ by. slow: see `Room`."""
    if volts_share == 0.0:
        return computed_V
    off = inputs.volts[j, i] - computed_V
    slow[j] = 0.0 if i == 0 else slow[j] + inputs.slow_share * (off - slow[j])  # both begin where the log does
    return computed_V + volts_share * (off - slow[j])


@compiled
def delayed_volts(part_s, held, was, at, dt, now):
    """Write the volts (n_legs,) that the spools have from `at` in a sample on; return until when [s], dt at most.

    held: of this sample, was: of the one before, which stay for part_s (`valve.delay_in_ticks`).
    """
    end = dt
    for j in range(now.shape[0]):
        now[j] = was[j] if part_s[j] > at else held[j]
        if at < part_s[j] < end:
            end = part_s[j]
    return end


def answer(rig: Rig, inputs: Inputs, start: np.ndarray) -> np.ndarray:
    """Measured outputs without noise (rows as in `run`, n) from a start state; NaN after a divergence."""
    out = np.empty((4 * len(rig.legs) + 1 + len(rig.sensors.acceleration), inputs.setpoint.shape[1]))
    run(rig, inputs, room_for(rig, inputs, start), out)
    return out


@compiled
def run(rig, inputs, room, out):
    """Simulate and write the measured outputs, without noise, into out. False after a divergence.

    out: rows of positions, volts, pressures of the bottom chambers and of the rod sides, supply, accelerations; (., n).
    """
    legs, geometry, s, load, sensors, controller, rule = rig
    position, pressure, top, acceleration, supply_gain, filters, place, turned = sensors
    state, slopes, (y, v, before, held, apart), (whole, part_s, was, now), slow = room[:5]
    y_true, p_true, top_true, u_true, asked, a_true, sharp, memory = room[5:]
    n_legs, n, rate = legs.shape[0], inputs.setpoint.shape[1], inputs.rate_Hz
    dt, axes = 1.0 / rate, acceleration.shape[0]
    every = max(round(rate / controller.rate_Hz), 1)
    calm_s = 0.0
    for i in range(n):
        t = inputs.start_s + i * dt
        write_leg_motion(geometry, state, y, v)
        tick = i == 0 or (i - inputs.first_tick) % every == 0
        for j in range(n_legs):
            k = LEGS + j * LEG_STATES
            y_true[j, i], p_true[j, i] = y[j], chamber.pressure(state[k + LEG_P1])
            if position[j, 4] != 0.0:
                y_true[j, i] = rippled(y[j], position[j, 4], position[j, 5], position[j, 6])
            top_true[j, i] = rod_side_pressure(legs[j], state, k)
            sharp[j] = shown(y_true[j], i, position[j], rate, sharp[j])
            out[j, i] = smoothed(filters[0], memory[j], sharp[j], i == 0)
            read = y[j] if controller.feedback == OWN_TRANSDUCER else out[j, i]
            asked[j, i] = asked_volts(controller, inputs, j, i, read) if tick else asked[j, i - 1]
            late = 0.0 if controller.feedback == LOGGED_VOLTS else controller.delay_ticks[j]
            out[n_legs + j, i] = computed(asked[j], i, late, every) if tick else out[n_legs + j, i - 1]
            u_true[j, i] = acting_volts(controller.volts_share, inputs, j, i, out[n_legs + j, i], slow)
            ahead = u_true[j, max(i - whole[j], 0)]
            was[j] = held[j]
            held[j], apart[j] = valve.hysteresis(
                ahead, held[j], apart[j], legs[j, P.HYSTERESIS], legs[j, P.HYSTERESIS_SPREAD]
            )
            if i == 0:
                was[j] = held[j]
            b, r = 2 * n_legs + j, 3 * n_legs + j
            sharp[b] = shown(p_true[j], i, pressure[j], rate, sharp[b])
            sharp[r] = shown(top_true[j], i, top[j], rate, sharp[r])
            out[b, i] = smoothed(filters[1], memory[b], sharp[b], i == 0)
            out[r, i] = smoothed(filters[1], memory[r], sharp[r], i == 0)
        out[4 * n_legs, i] = supply_gain * chamber.pressure(state[SUPPLY])
        calm_s = dt if inputs.near_rest[i] else calm_s + dt
        for j in range(n_legs):
            if near_standstill(legs[j], v[j], before[j]):
                calm_s = 0.0
            before[j] = v[j]
        at, end = 0.0, delayed_volts(part_s, held, was, 0.0, dt, now)
        steps = steps_of_sample(legs, s, rule, state, y, v, now, t, calm_s, end)
        a, turning = rates(legs, geometry, s, load, now, t, end / steps, state, slopes[0])
        write_accelerations(state, a, turning, place, turned, a_true[:, i])
        for k in range(axes):
            r = 4 * n_legs + 1 + k
            sharp[r] = shown(a_true[k], i, acceleration[k], rate, sharp[r])
            out[r, i] = smoothed(filters[2], memory[r], sharp[r], i == 0) if k < 3 else sharp[r]
        integrate(legs, geometry, s, load, now, t, end, steps, state, slopes)
        while end < dt:
            at, end = end, delayed_volts(part_s, held, was, end, dt, now)
            write_leg_motion(geometry, state, y, v)
            steps = steps_of_sample(legs, s, rule, state, y, v, now, t + at, calm_s, end - at)
            rates(legs, geometry, s, load, now, t + at, (end - at) / steps, state, slopes[0])
            integrate(legs, geometry, s, load, now, t + at, end - at, steps, state, slopes)
        if diverged(state, LEGS + n_legs * LEG_STATES):
            out[:, i + 1 :] = math.nan
            return False
    return True


@compiled
def write_accelerations(state, a, turning, place, turned, at):
    """What accelerometers at `place`, their axes the columns of `turned`, feel: (1,) of a bench, (6,) of a platform."""
    if at.shape[0] == 1:
        at[0] = a[2]
        return
    omega = triple(state, state.shape[0] - N_PLATFORM + OMEGA)
    swing, pull = cross(turning, place), cross(omega, cross(omega, place))
    for k in range(3):
        at[k] = at[k + 3] = 0.0
        for j in range(3):
            at[k] += turned[j, k] * (a[j] + swing[j] + pull[j])
            at[k + 3] += turned[j, k] * turning[j]


@compiled
def diverged(state, at):
    """Is any state of the load beyond all bounds?"""
    largest = 0.0
    for k in range(at, state.shape[0]):
        largest = max(largest, abs(state[k]) if math.isfinite(state[k]) else math.inf)
    return largest > DIVERGENCE_LIMIT
