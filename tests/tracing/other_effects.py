"""What the second plant can have and its machine file does not declare: effects with a library's name, and others.

`typical` is the typical strength x1 (in `unit`); `change(plant, legs, value)` puts it into the plant's records.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, kw_only=True)
class Injected:
    """An effect of the second plant. balance, also_balances, depends_on: what a tracer may rightly say of it."""

    description: str
    balance: str
    typical: float
    unit: str
    change: Callable
    in_library: bool = True
    also_balances: tuple[str, ...] = ()
    depends_on: tuple[str, ...] = ()
    frequency_Hz: float | None = None
    place: str = "leg"  # leg, platform or machine
    kinds: tuple[str, ...] = ("bench", "hexapod")
    typical_hexapod: float | None = None

    def size(self, kind: str) -> float:
        """Believable strength x1 on a machine of this kind."""
        return self.typical_hexapod if kind == "hexapod" and self.typical_hexapod is not None else self.typical


def set_leg(*names, **fixed):
    """Put the value into fields of the chosen legs, and constants into others."""

    def change(plant, legs, value):
        for leg in legs:
            for name in names:
                plant.legs[name][leg] = value
            for name, constant in fixed.items():
                plant.legs[name][leg] = constant

    return change


def add_leg(name, factors=(1.0,), relative=False):
    """Add to a field (or scale it by 1 + value) of the chosen legs; several names with their own factors."""
    names = (name,) if isinstance(name, str) else name

    def change(plant, legs, value):
        for leg in legs:
            for one, factor in zip(names, factors, strict=True):
                old = plant.legs[one][leg]
                plant.legs[one][leg] = old * (1.0 + factor * value) if relative else old + factor * value

    return change


def set_rig(*names, **fixed):
    def change(plant, legs, value):
        for name in names:
            plant.rig[name] = value
        for name, constant in fixed.items():
            plant.rig[name] = constant

    return change


def scale_rig(*names):
    def change(plant, legs, value):
        for name in names:
            plant.rig[name] *= 1.0 + value

    return change


def per_legs(plant, bench_value):
    """Supply effects: six legs take six times the flow."""
    return bench_value / float(plant.rig["n_legs"][0])


def droop(plant, legs, value):
    set_rig("line_resistance", line_capacity=6e-12)(plant, legs, value)


def pump_limit(plant, legs, value):
    set_rig("pump_flow", line_resistance=1e8, line_capacity=4e-11 * float(plant.rig["n_legs"][0]))(plant, legs, value)


def small_accumulator(plant, legs, value):
    set_rig("gas_volume", gas_exponent=1.3, line_resistance=per_legs(plant, 8e9))(plant, legs, value)


def payload(omega_Hz, gap=0.0):
    """A share of the mass hangs on a spring (and, with a gap, in stops)."""

    def change(plant, legs, value):
        plant.rig["payload_mass"] = plant.rig["mass"] * value
        plant.rig["mass"] *= 1.0 - value
        plant.rig["payload_omega"] = 2 * np.pi * omega_Hz
        plant.rig["payload_damping"] = 0.03
        plant.rig["payload_gap"] = gap
        plant.rig["payload_stop"] = 4e4

    return change


def inertia(plant, legs, value):
    for axis in "xy":
        plant.rig[f"inertia_{axis}"] *= 1.0 + value


def lib(says, balance, typical, unit, change, **more):
    return Injected(description=says, balance=balance, typical=typical, unit=unit, change=change, **more)


def outside(says, balance, typical, unit, change, depends_on, **more):
    return Injected(
        description=says,
        balance=balance,
        typical=typical,
        unit=unit,
        change=change,
        in_library=False,
        depends_on=depends_on,
        **more,
    )


def joint(name, axis):
    """A joint of the base or of the platform of the chosen legs is elsewhere."""

    def change(plant, legs, value):
        for leg in legs:
            getattr(plant, name)[leg, axis] += value

    return change


def built(says, typical, unit, change, balance="platform", **more):
    """How a hexapod is built."""
    return lib(says, balance, typical, unit, change, kinds=("hexapod",), **more)


FRICTION_BOTH = ("coulomb_out", "coulomb_in")
EFFECTS: dict[str, Injected] = {
    # supply and return
    "supply_droop": lib(
        "pump line resistance, accumulator 6e-12 m3/Pa", "supply", 2.4e9, "Pa s/m3", droop, place="machine"
    ),
    "pump_limit": lib(
        "pump gives no more flow than this", "supply", 6e-5, "m3/s", pump_limit, place="machine", typical_hexapod=2e-4
    ),
    "supply_accumulator": lib(
        "gas accumulator behind a slow pump", "supply", 4e-4, "m3", small_accumulator, place="machine"
    ),
    "return_line": lib("return line backs up", "continuity", 1.5e9, "Pa s/m3", set_leg("return_resistance")),
    # continuity
    "leakage_supply_to_chamber": lib(
        "laminar leak supply to chamber", "continuity", 1.8e-12, "m3/s/Pa", set_leg("leak_supply")
    ),
    "leakage_chamber_to_tank": lib(
        "laminar leak chamber to tank", "continuity", 1.8e-12, "m3/s/Pa", set_leg("leak_tank")
    ),
    "leakage_clearance": lib(
        "laminar leak over both lands near null, clearance length 3 um",
        "continuity",
        4e-12,
        "m3/s/Pa",
        set_leg("clearance", clearance_length=3e-6),
    ),
    "entrained_air": lib("free air at one atmosphere", "continuity", 0.007, "1", set_leg("air")),
    "hose_compliance": lib("hose gives way", "continuity", 5e-14, "m3/Pa", set_leg("hose")),
    "dead_volume": lib("more oil than declared", "continuity", 4e-5, "m3", add_leg("pipe_volume")),
    # valve
    "overlap": lib("overlap larger by", "valve", 8e-6, "m", add_leg(("overlap_supply", "overlap_tank"), (1.0, 1.0))),
    "underlap": lib(
        "overlap smaller by", "valve", 8e-6, "m", add_leg(("overlap_supply", "overlap_tank"), (-1.0, -1.0))
    ),
    "laminar_edge": lib("edges laminar below a Reynolds number", "valve", 15.0, "1", set_leg("laminar")),
    "laminar_edge_merritt": lib(
        "edges laminar up to a corner of C_d", "valve", 15.0, "1", set_leg("laminar", laminar_law=1.0)
    ),
    "laminar_edge_wu": lib("edges whose C_d overshoots", "valve", 15.0, "1", set_leg("laminar", laminar_law=2.0)),
    "null_offset": lib("null of the spool", "valve", 0.04, "V", set_leg("null_offset")),
    "null_drift": lib("null of the spool wanders with time", "valve", 3e-3, "V/s", set_leg("null_drift")),
    "unequal_ports": lib(
        "supply port wider and tank port narrower by",
        "valve",
        0.08,
        "1",
        add_leg(("gradient_supply", "gradient_tank"), (1.0, -1.0), relative=True),
    ),
    "spool_lag": lib(
        "spool of second order, damping 0.7, at", "valve", 30.0, "Hz", set_leg("spool_frequency", spool_damping=0.7)
    ),
    "spool_rate_limit": lib("spool no faster than", "valve", 8e-4, "m/s", set_leg("spool_rate")),
    "valve_hysteresis": lib("backlash of the spool, half width", "valve", 0.04, "V", set_leg("hysteresis")),
    "valve_delay": lib("valve acts late by", "valve", 6.0, "ms", set_leg("valve_delay_ms")),
    # force
    "coulomb_friction": lib(
        "Coulomb friction more by, both directions", "force", 60.0, "N", add_leg(FRICTION_BOTH, (1.0, 1.0))
    ),
    "viscous_friction": lib(
        "viscous friction more by, both directions",
        "force",
        900.0,
        "N s/m",
        add_leg(("viscous_out", "viscous_in"), (1.0, 1.0)),
    ),
    "stribeck_change": lib(
        "static friction more by, both directions", "force", 60.0, "N", add_leg(("static_out", "static_in"), (1.0, 1.0))
    ),
    "presliding": lib(
        "LuGre bristles of stiffness (damping 1e4 N s/m)",
        "force",
        2e6,
        "N/m",
        set_leg("bristle_stiffness", bristle_damping=1e4),
    ),
    "seal_friction": lib("Coulomb friction grows with chamber pressure", "force", 3e-5, "N/Pa", set_leg("seal")),
    "friction_of_position": lib(
        "Coulomb friction ripples along the stroke, 30 mm", "force", 40.0, "N", set_leg("ripple", ripple_length=0.03)
    ),
    "mass": lib("mass more by", "force", 0.15, "1", scale_rig("mass"), place="platform"),
    "incline": lib("leg inclined", "force", 0.4, "rad", set_rig("incline"), place="platform", kinds=("bench",)),
    "spring": lib("spring about mid stroke", "force", 3000.0, "N/m", set_leg("spring")),
    "flexible_payload": lib(
        "share of the mass on a spring of 8 Hz",
        "force",
        0.2,
        "1",
        payload(8.0),
        place="platform",
        also_balances=("platform",),
    ),
    "outside_force": lib("force at 7.3 Hz", "force", 40.0, "N", set_leg("tone", tone_frequency=7.3)),
    # sensors
    "accelerometer_gain": lib(
        "accelerometer reads more by", "sensor", 0.08, "1", scale_rig("acceleration_gain"), place="platform"
    ),
    "accelerometer_offset": lib(
        "accelerometer offset", "sensor", 0.2, "m/s2", set_rig("acceleration_offset"), place="platform"
    ),
    "accelerometer_delay": lib(
        "accelerometer late by", "sensor", 6.0, "ms", set_rig("acceleration_delay_ms"), place="platform"
    ),
    "pressure_gain": lib(
        "chamber pressure reads more by", "sensor", 0.04, "1", add_leg("pressure_gain", relative=True)
    ),
    "pressure_offset": lib("chamber pressure offset", "sensor", 8e4, "Pa", set_leg("pressure_offset")),
    "pressure_delay": lib("chamber pressure late by", "sensor", 6.0, "ms", set_leg("pressure_delay_ms")),
    "supply_pressure_gain": lib(
        "supply pressure reads more by", "sensor", 0.04, "1", scale_rig("supply_gain"), place="machine"
    ),
    "position_gain": lib("position reads more by", "sensor", 0.03, "1", add_leg("position_gain", relative=True)),
    "position_delay": lib("position late by", "sensor", 6.0, "ms", set_leg("position_delay_ms")),
    # platform
    "centre_of_mass": lib(
        "centre of mass off along x", "platform", 0.05, "m", set_rig("com_x"), place="platform", kinds=("hexapod",)
    ),
    "platform_inertia": lib(
        "inertia about x and y more by", "platform", 0.4, "1", inertia, place="platform", kinds=("hexapod",)
    ),
    "leg_differs": lib(
        "discharge coefficient of a leg less by",
        "continuity",
        0.12,
        "1",
        add_leg("discharge", (-1.0,), relative=True),
        kinds=("hexapod",),
    ),
    # in no library
    "cubic_friction": outside(
        "friction with the cube of velocity", "force", 4e4, "N s3/m3", set_leg("cubic"), ("velocity_m_s",)
    ),
    "flow_gain_of_position": outside(
        "valve passes more at long stroke: +- at the ends",
        "continuity",
        0.15,
        "1",
        set_leg("gain_position"),
        ("position_m",),
        also_balances=("valve",),
    ),
    "flow_gain_of_voltage": outside(
        "valve passes more when far open: per volt",
        "valve",
        0.15,
        "1/V",
        set_leg("gain_voltage"),
        ("valve_V", "velocity_m_s"),
        also_balances=("continuity",),
    ),
    "discharge_of_pressure": outside(
        "discharge coefficient grows with pressure drop: per 35 bar",
        "valve",
        0.3,
        "1",
        set_leg("gain_pressure"),
        ("pressure_bottom_Pa", "velocity_m_s", "valve_V"),
        also_balances=("continuity",),
    ),
    "stick_at_one_place": outside(
        "friction bump at 108 mm, 4 mm wide",
        "force",
        120.0,
        "N",
        set_leg("stick", stick_place=0.108, stick_width=0.004),
        ("position_m",),
    ),
    "oil_warms_up": outside(
        "viscous friction fades by this share in 20 s",
        "force",
        0.5,
        "1",
        lambda plant, legs, value: set_leg("cooling")(plant, legs, value / 20.0),
        ("time_s", "velocity_m_s"),
    ),
    "rod_side_air": outside(
        "air pocket on the rod side behind a narrow port", "force", 4e-6, "m3", set_leg("rod_air"), ("velocity_m_s",)
    ),
    "pipe_inertia_one_way": outside(
        "oil of the rod-side pipe is pushed on extension only: line inertia",
        "force",
        4e7,
        "Pa s2/m3",
        set_leg("line_inertia"),
        ("acceleration_m_s2", "velocity_m_s"),
        kinds=("bench",),
    ),
    "rod_line_loss_one_way": outside(
        "rod-side line loss on extension only", "force", 5e13, "Pa s2/m6", set_leg("line_loss"), ("velocity_m_s",)
    ),
    "floor_vibration": outside(
        "floor shakes at 23 Hz",
        "sensor",
        0.3,
        "m/s2",
        set_rig("floor", floor_frequency=23.0),
        ("time_s",),
        frequency_Hz=23.0,
        place="platform",
        also_balances=("force", "platform"),
    ),
    "sliding_payload": outside(
        "share of the mass that slides 1 mm between stops",
        "force",
        0.25,
        "1",
        payload(2.5, gap=1e-3),
        ("acceleration_m_s2", "time_s"),
        place="platform",
        also_balances=("platform",),
    ),
    "controller_jitter": outside(
        "valve update late by a random time up to",
        "valve",
        1.8e-3,
        "s",
        set_rig("jitter_s"),
        ("valve_V", "time_s"),
        place="machine",
        also_balances=("continuity",),
    ),
    "pressure_hum": outside(
        "electrical interference on the pressure, 37 Hz",
        "sensor",
        6e4,
        "Pa",
        set_leg("hum", hum_frequency=37.0),
        ("time_s",),
        frequency_Hz=37.0,
        also_balances=("force", "continuity"),
    ),
    "friction_memory": outside(
        "Coulomb friction grows with the speed of the last 0.4 s: at 50 mm/s by",
        "force",
        1.0,
        "1",
        set_leg("memory"),
        ("velocity_m_s", "time_s"),
    ),
    "position_backlash": outside(
        "play in the position transducer's joint, half width",
        "sensor",
        8e-5,
        "m",
        set_leg("position_play"),
        ("velocity_m_s", "position_m"),
    ),
}


def lag(plant, legs, value):
    set_leg("spool_frequency", spool_damping=0.7)(plant, legs, value)


def small(says, balance, unit, change, **more):
    """One of the nuisance effects of `rough_machines`, which draws its size."""
    return Injected(
        description=says, balance=balance, typical=0.0, unit=unit, change=change, in_library=False, kinds=(), **more
    )


SMALL_REALITIES = {
    "scale_ripple": small("the scale errs along the stroke", "sensor", "m", set_leg("scale_error", scale_length=1e-3)),
    "small_spool_lag": small("spool at", "valve", "Hz", lag),
    "small_accelerometer_gain": small("accelerometer reads more by", "sensor", "1", scale_rig("acceleration_gain")),
    "small_position_delay": small("position late by", "sensor", "ms", set_leg("position_delay_ms")),
    "friction_warm_up": small("friction fades by", "force", "1", set_leg("warm_up", warm_up_s=8.0)),
    "small_seal_friction": small("friction grows with pressure", "force", "N/Pa", set_leg("seal")),
    "small_air": small("free air", "continuity", "1", set_leg("air")),
    "small_null_offset": small("null of the spool", "valve", "V", set_leg("null_offset")),
    "small_null_drift": small("null wanders", "valve", "V/s", set_leg("null_drift")),
    "worn_bore": small("leak at 92 mm", "continuity", "m3/s/Pa", set_leg("wear", wear_place=0.092, wear_width=0.008)),
    "small_return_line": small("return line backs up", "continuity", "Pa s/m3", set_leg("return_resistance")),
    "pump_ripple": small("pump ripple at 31 Hz", "supply", "Pa", set_rig("pump_ripple", pump_frequency=31.0)),
    "small_unequal_ports": small(
        "ports differ", "valve", "1", add_leg(("gradient_supply", "gradient_tank"), (1.0, -1.0), relative=True)
    ),
    "hardening_spring": small("spring that hardens", "force", "N/m3", set_leg("hardening")),
    "small_friction_of_position": small("friction ripples, 30 mm", "force", "N", set_leg("ripple", ripple_length=0.03)),
}

# how a hexapod is built: below the noise of any one sample
BUILT_OTHERWISE = {
    "base_joint_x": built("base joint off along x", 1e-3, "m", joint("base", 0)),
    "base_joint_z": built("base joint off along z", 1e-3, "m", joint("base", 2)),
    "platform_joint_x": built("platform joint off along x", 1e-3, "m", joint("joints", 0)),
    "platform_joint_z": built("platform joint off along z", 1e-3, "m", joint("joints", 2)),
    "leg_zero": built("leg longer at the same reading by", 5e-4, "m", set_leg("longer")),
    "imu_turn": built(
        "IMU turned about y by", 0.017453, "rad", set_rig("imu_turn_y"), balance="sensor", place="platform"
    ),
    "position_lag": lib("position behind a lag of", "sensor", 4.0, "ms", set_leg("position_lag_ms")),
    "pressure_lag": lib("chamber pressure behind a lag of", "sensor", 4.0, "ms", set_leg("pressure_lag_ms")),
}

# what the project's library calls the effects that it has under another name
LIBRARY_NAMES = {
    "scale_ripple": "position_ripple",
    "pump_limit": "pump_flow_limit",
    "supply_accumulator": "gas_accumulator",
    "return_line": "return_line_back_pressure",
    "leakage_clearance": "clearance_leakage",
    "laminar_edge_merritt": "laminar_edge",
    "laminar_edge_wu": "laminar_edge",
    "overlap": "overlap_change",
    "underlap": "overlap_change",
    "coulomb_friction": "coulomb_friction_change",
    "viscous_friction": "viscous_friction_change",
    "stribeck_change": "stribeck_friction_change",
    "seal_friction": "pressure_dependent_friction",
    "friction_of_position": "position_dependent_friction",
    "mass": "mass_change",
    "outside_force": "outside_force_tone",
    "platform_inertia": "inertia_change",
    "leg_differs": "valve_gain_change",
}
