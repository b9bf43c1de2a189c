"""What a compensator is told of a leg: what an engineer reads off the data sheets, out of the machine file."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from compensation import Context
from compensation.volts_bound import edge_V
from hexsim.declaration import Machine
from hexsim.hydraulics.parameters import P, declared_rows
from hexsim.motion_computer.leg_load import ExpectedLoad


def compensator_context(
    machine: Machine,
    period_s: float | None,
    leg: int = 1,
    load: ExpectedLoad | None = None,
    *,
    least_m: float = 1e-7,  # [m] of an ideal transducer
    reading_sd: float = 4.0,  # noises of a reading, of which the loop itself makes volts on a valve without overlap and friction
) -> Context:
    """Of a leg, from 1; load: of a platform.

    Overlap, friction and discharge coefficient enter the bound of what may be added, and nothing else.
    """
    own = machine.legs[leg - 1]
    cylinder, sensors = own.cylinder, own.sensors
    omega_1_s, damping, _ = own.valve.spool
    noise_m = math.hypot(sensors.position_noise_m, sensors.position_resolution_m)
    gain, most_V = _valve_numbers(declared_rows(machine)[leg - 1])
    return Context(
        rate_Hz=machine.controller.rate_Hz,
        position_gain_V_per_m=own.controller.gain_V_per_m,
        voltage_max_V=own.valve.voltage_max_V,
        stroke_m=cylinder.stroke_m,
        area_bottom_m2=cylinder.area_bottom_m2,
        area_top_m2=cylinder.area_top_m2,
        supply_pressure_Pa=machine.supply.pressure_Pa,
        tank_pressure_Pa=machine.supply.tank_pressure_Pa,
        bulk_modulus_Pa=machine.oil.bulk_modulus_Pa,
        pipeline_volume_m3=cylinder.pipeline_volume_m3,
        four_way=cylinder.rod_side == "valve",
        pipeline_volume_top_m3=cylinder.rod_side_volume_m3,
        position_noise_m=sensors.position_noise_m,
        position_resolution_m=sensors.position_resolution_m,
        pressure_noise_Pa=sensors.pressure_noise_Pa,
        pressure_resolution_Pa=sensors.pressure_resolution_Pa,
        spool_damping=damping,
        spool_frequency_Hz=omega_1_s / (2.0 * math.pi),
        stribeck_velocity_m_s=own.friction.stribeck_velocity_m_s,
        edge_V=max(most_V, own.controller.gain_V_per_m * (reading_sd * noise_m + least_m)),
        velocity_gain_m_s_V=gain,
        velocity_gain_V_s_per_m=own.controller.velocity_gain_V_s_per_m,
        velocity_filter_Hz=own.controller.velocity_filter_Hz,
        pressure_gain_V_per_Pa=own.controller.pressure_feedback_V_per_Pa,
        pressure_high_pass_Hz=own.controller.pressure_high_pass_Hz,
        own_mobility=1.0 if load is None else float(1.0 / load.mobility[leg - 1, leg - 1]),
        mobility=() if load is None else tuple(map(float, load.mobility[leg - 1] / load.mobility[leg - 1, leg - 1])),
        leg=leg - 1,
        load_over_weight=1.0 if load is None else load.over_weight,
        controller_feeds_forward=machine.controller.velocity_feed_forward_V_s_per_m > 0.0,
        period_s=period_s,
    )


def _valve_numbers(row: NDArray[np.float64]) -> tuple[float, float]:
    """Velocity gain k [m/s/V] of the smaller edge, at half the supply pressure across it, and e [V] of `compensation.volts_bound`."""
    drop_Pa = 0.5 * (row[P.SUPPLY_PRESSURE] - row[P.TANK_PRESSURE])
    speed = row[P.DISCHARGE] * math.sqrt(2.0 * drop_Pa / row[P.DENSITY]) / row[P.AREA_BOTTOM]
    widths = row[[P.AREA_GRADIENT_SUPPLY, P.AREA_GRADIENT_TANK]]
    if row[P.QUADRATIC_GAIN] > 0.0:  # a(x) = gain x^2: mean slope up to full travel
        widths = np.array([row[P.QUADRATIC_GAIN] * row[P.SPOOL_TRAVEL]])
    gain = speed * float(widths.min()) * row[P.SPOOL_GAIN]
    area_m2 = row[P.AREA_BOTTOM]
    friction_N = row[P.COULOMB_EXTEND] + row[P.STATIC_EXTEND] + row[P.COULOMB_RETRACT] + row[P.STATIC_RETRACT]
    overlaps = np.abs(row[[P.OVERLAP_SUPPLY, P.OVERLAP_TANK, P.OVERLAP_SUPPLY_TOP, P.OVERLAP_TANK_TOP]]).max()
    roundings = row[[P.ROUNDING_SUPPLY, P.ROUNDING_TANK, P.ROUNDING_SUPPLY_TOP, P.ROUNDING_TANK_TOP]].max()
    leaks = row[[P.LEAK_SUPPLY_CHAMBER, P.LEAK_CHAMBER_TANK, P.LEAK_PISTON, P.LEAK_TOP_TANK]].sum()
    return gain, edge_V(
        float(overlaps / row[P.SPOOL_GAIN]),
        float(roundings / row[P.SPOOL_GAIN]),
        row[P.HYSTERESIS],
        row[P.NULL_OFFSET],
        leaks * row[P.SUPPLY_PRESSURE] / area_m2,
        friction_N / area_m2,
        (0.5 * row[P.STROKE] + row[P.PIPELINE_VOLUME] / area_m2) / row[P.BULK_MODULUS],
        gain,
    )
