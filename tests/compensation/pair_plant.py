"""A leg with two chambers on a four-way valve, for the compensators' tests: no code of hexsim.

Vertical, four edges with rounded corners, second-order spool behind delay and hysteresis, leak across the piston, free air,
back pressure of the return line, friction as in `leg_plant`. The orifices and the oil are those of the other writer's plant
(tests/tracing/four_edge_plant.py). Heun's method, 20 us a step.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import astuple, dataclass
from pathlib import Path

import numpy as np
from leg_plant import GRAVITY, Record
from numba import njit

sys.path.insert(0, str(Path(__file__).parents[1] / "tracing"))

from four_edge_plant import (  # pyright: ignore[reportMissingImports]
    AIR,
    FIELDS,
    MODULUS,
    orifice,
    softness,
    through,
)

from compensation import Compensator, Context, Sample, preview_count

STEP_S, OUT_S, RATE_HZ, LIMIT_V = 2e-5, 1e-4, 500.0, 10.0
SUPPLY, TANK, STROKE, DEAD_M3, TRAVEL_M = 1.6e7, 2e5, 0.6, 4e-5, 5e-4
AREA, FLOW, DROP, GAIN_V_M = 9.456e-4, 6.3333e-4, 3.5e6, 60.0
fast = njit(cache=True, error_model="numpy", _nrt=False)  # makes no arrays, so that no owner need be counted


@dataclass
class PairLeg:
    """Numbers of a motion base's leg, and what is wrong with it."""

    mass_kg: float = 250.0
    ratio: float = 1.0  # of the areas
    modulus_Pa: float = 1.3e9
    overlap_m: float = 0.0
    rounding_m: float = 2e-6
    spool_Hz: float = 80.0
    viscous_N_s_m: float = 900.0
    coulomb_N: float = 90.0
    static_N: float = 30.0
    piston_leak_m3_s_Pa: float = 5e-13
    air: float = 0.0
    return_Pa_s_m3: float = 0.0
    null_V: float = 0.0
    backlash_V: float = 0.0
    valve_delay_s: float = 0.0
    position_delay_s: float = 0.0


@fast
def slope_of(c, oil, s, volts, out):
    """Rates of (P1, P2, x, x', y, v); c: the leg's row; oil: row of the other plant, of its modulus and air."""
    mass, ratio, _, lap, soft, spool, viscous, coulomb, static, leak, _, back = c[:12]
    P1, P2, x, speed, y, v = s
    w = 2.0 * np.pi * spool
    out[2], out[3] = speed, w * (w * (volts / LIMIT_V * TRAVEL_M - x) - 1.6 * speed)
    g = FLOW / TRAVEL_M / np.sqrt(DROP)
    into = orifice(g, x - lap, soft, SUPPLY - P1) - through(g, -x - lap, soft, P1 - TANK, back)
    up = orifice(g, -x - lap, soft, SUPPLY - P2) - through(g, x - lap, soft, P2 - TANK, back)
    seep = leak * (P1 - P2)
    out[0] = (into - seep - AREA * v) / softness(DEAD_M3 + AREA * y, P1, oil)
    out[1] = (up + seep + ratio * AREA * v) / softness(DEAD_M3 + ratio * AREA * (STROKE - y), P2, oil)
    dry = (coulomb + static * np.exp(-abs(v) / 5e-3)) * np.tanh(v / 2e-4)
    out[4], out[5] = v, (AREA * (P1 - ratio * P2) - viscous * v - dry) / mass - GRAVITY


@fast
def advance(c, oil, s, volts, positions, accelerations, space):
    """A control tick; volts, positions and accelerations every 1e-4 s."""
    k1, k2, there = space[0], space[1], space[2]
    for i in range(len(volts)):
        for j in range(round(OUT_S / STEP_S)):
            slope_of(c, oil, s, volts[i], k1)
            if j == 0:
                positions[i], accelerations[i] = s[4], k1[5]
            for part in range(6):
                there[part] = s[part] + STEP_S * k1[part]
            slope_of(c, oil, there, volts[i], k2)
            for part in range(6):
                s[part] += 0.5 * STEP_S * (k1[part] + k2[part])


def context_of(leg: PairLeg, period_s: float | None) -> Context:
    """The leg's data sheet."""
    return Context(
        rate_Hz=RATE_HZ, position_gain_V_per_m=GAIN_V_M, stroke_m=STROKE, area_bottom_m2=AREA, area_top_m2=leg.ratio * AREA,
        supply_pressure_Pa=SUPPLY, tank_pressure_Pa=TANK, bulk_modulus_Pa=1.3e9, pipeline_volume_m3=DEAD_M3, four_way=True,
        pipeline_volume_top_m3=DEAD_M3, pressure_noise_Pa=8e3, period_s=period_s,
    )  # fmt: skip


def run_pair(
    compensator: Compensator,
    leg: PairLeg,
    setpoint: Callable[[np.ndarray], np.ndarray],
    duration_s: float,
    *,
    period_s: float | None = None,
    seed: int = 0,
) -> Record:
    """Drive the leg about mid-stroke; the setpoint is about 0.1 m, as of `leg_plant`."""
    context = context_of(leg, period_s)
    state, steps, ticks = compensator.start(context), round(1.0 / RATE_HZ / OUT_S), round(duration_s * RATE_HZ)
    look = preview_count(compensator, context)
    wanted = setpoint(np.arange(ticks + look) / RATE_HZ) + 0.5 * STROKE - 0.1
    noise = np.random.default_rng(seed).normal(0.0, 1.0, (ticks, 4)) * [3e-6, 8e3, 8e3, 8e3]
    row, oil = np.array(astuple(leg)), np.zeros(len(FIELDS))
    oil[MODULUS], oil[AIR] = leg.modulus_Pa, leg.air
    held = leg.mass_kg * GRAVITY / AREA
    P2 = (SUPPLY + TANK - held) / (1.0 + leg.ratio)
    s = np.array([held + leg.ratio * P2, P2, 0.0, 0.0, wanted[0], 0.0])
    late, back = round(leg.valve_delay_s / OUT_S), round(leg.position_delay_s / OUT_S)
    volts, true_m = np.zeros(ticks * steps + late), np.full(ticks * steps, wanted[0])
    position, valve, added, accelerations = np.zeros(ticks), np.zeros(ticks), np.zeros(ticks), np.zeros(ticks * steps)
    sent, follower, space = 0.0, 0.0, np.empty((3, 6))
    for k in range(ticks):
        now = slice(k * steps, (k + 1) * steps)
        true_m[k * steps] = s[4]
        y = round((true_m[max(k * steps - back, 0)] + noise[k, 0]) / 3e-6) * 3e-6
        here = float(wanted[k])
        bottom, top, supply = (float(x) for x in (s[0] + noise[k, 1], s[1] + noise[k, 2], SUPPLY + noise[k, 3]))
        sample = Sample(
            k / RATE_HZ, here, wanted[k : k + look], y, GAIN_V_M * (here - y), sent, bottom, supply, pressure_top_Pa=top
        )
        more, state = compensator.step(state, sample)
        total = sample.control_V + more
        sent = min(max(total, -LIMIT_V), LIMIT_V) if math.isfinite(total) else 0.0
        follower = min(max(follower, sent - leg.backlash_V), sent + leg.backlash_V)
        volts[k * steps + late : (k + 1) * steps + late] = follower - leg.null_V
        position[k], valve[k], added[k] = s[4], sent, more
        advance(row, oil, s, volts[now], true_m[now], accelerations[now], space)
    return Record(np.arange(ticks) / RATE_HZ, position, valve, added, accelerations, state)
