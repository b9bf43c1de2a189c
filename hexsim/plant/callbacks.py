# pyright: reportAttributeAccessIssue=false, reportCallIssue=false, reportArgumentType=false, reportPrivateImportUsage=false
# (MuJoCo's bindings carry no types, and numba's intrinsics are called without their typing context)
"""Native control callbacks: MuJoCo calls the compiled hydraulics at every evaluation, no Python in between.

`mjcb_act_dyn` gives the rates of each actuator's states (the last one is the pressure), `mjcb_act_bias` what acts along
the leg besides P1 A1; P1 A1 itself is MuJoCo's linear gain on the last state, so that `actearly` sees the new pressure.
Inside MuJoCo pressures are in MPa (it rejects rates above 1e10); everywhere else they are in Pa.

All numbers come from the model (`actuator_user`: a leg's row, or the supply's) and all states from the data, so one
pair of callbacks serves any number of models and threads. `userdata[2 i]` and `userdata[2 i + 1]` carry leg i's demand
and heat to the supply.
"""

from __future__ import annotations

import ctypes
import operator
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

import mujoco
import numpy as np
from llvmlite import ir
from numba import carray, cfunc, types
from numba.extending import intrinsic, overload

from hexsim.compiled import compiled
from hexsim.hydraulics import leg, supply, valve
from hexsim.hydraulics.parameters import N_PARAMETERS, P
from hexsim.hydraulics.supply import S
from hexsim.plant.layout import slot

MPa = 1.0e6  # [Pa]
POWER_UNIT_SCALE = np.array([1.0, 1.0, 1.0, MPa, 1.0, MPa])  # SI over what stands in act, places U
SUPPLY_MARK = -2.0  # in place of ACT_PRESSURE: this row belongs to the supply
_WORDS = 4096  # enough words of either struct to reach the fields that are read


@intrinsic
def _doubles(typingctx, address):
    """An address as a pointer to doubles."""
    signature = types.CPointer(types.float64)(types.uintp)

    def codegen(context, builder, signature, args):
        return builder.inttoptr(args[0], ir.PointerType(ir.DoubleType()))

    return signature, codegen


@compiled
def supply_pressure(p, act):
    """Ps [Pa]: the manifold's state, or the constant supply of the report."""
    place = int(p[P.ACT_SUPPLY])
    return act[place] * MPa if place >= 0 else p[P.SUPPLY_PRESSURE]


@compiled
def leg_instant(p, act, volts, t):
    """(x, P1, P2, Ps, z) of a leg from MuJoCo's act: SI units."""
    x = leg.commanded_spool(p, volts, t)
    if p[P.ACT_SPOOL] >= 0.0:
        x = min(max(act[int(p[P.ACT_SPOOL])], -p[P.SPOOL_TRAVEL]), p[P.SPOOL_TRAVEL])
    P1 = act[int(p[P.ACT_PRESSURE])] * MPa
    Ps = supply_pressure(p, act)
    P2 = act[int(p[P.ACT_ROD_SIDE])] * MPa if p[P.ACT_ROD_SIDE] >= 0.0 else Ps
    z = act[int(p[P.ACT_BRISTLE])] if p[P.ACT_BRISTLE] >= 0.0 else 0.0
    return x, P1, P2, Ps, z


@compiled
def leg_rates(p, act, act_dot, y, v, volts, t):
    """Write the rates of one leg's states into act_dot; return its demand on the supply [m3/s] and its heat [W]."""
    x, P1, P2, Ps, z = leg_instant(p, act, volts, t)
    flow = leg.inflow(p, y, v, volts, x, P1, Ps, t)
    demand, heat = 0.0, 0.0
    if p[P.ACT_SUPPLY] >= 0.0:  # before anything is written, so that the compiler shares terms with `flow`
        demand = leg.supply_demand_in_step(p, y, v, x, P1, P2, Ps)
        heat = leg.heat(p, y, v, P1, P2, Ps, z, flow, demand)
    if p[P.ACT_SPOOL] >= 0.0:
        place = int(p[P.ACT_SPOOL])
        command = leg.commanded_spool(p, volts, t)
        act_dot[place], act_dot[place + 1] = valve.spool_rates(
            act[place], act[place + 1], command, p[P.SPOOL_OMEGA], p[P.SPOOL_DAMPING], p[P.SPOOL_RATE]
        )
    if p[P.ACT_BRISTLE] >= 0.0:
        rate = leg.bristle_rate(p, y, v, P1, z)
        stiff = p[P.BRISTLE_STIFFNESS] * abs(v) / leg.friction_level(p, y, v, P1)
        act_dot[int(p[P.ACT_BRISTLE])] = rate / (1.0 + p[P.BRISTLE_STEP] * stiff)
    if p[P.ACT_ROD_SIDE] >= 0.0:
        act_dot[int(p[P.ACT_ROD_SIDE])] = leg.rod_side_rate(p, y, v, P2, Ps) / MPa
    rate = leg.pressure_rate_of(p, y, v, P1, flow)
    if p[P.IMPLICIT_STEP] > 0.0:  # fast scheme: linearly implicit in P1
        rate /= 1.0 - p[P.IMPLICIT_STEP] * leg.flow_slope(p, x, P1, Ps) / leg.chamber_capacity(p, y, P1)
    else:  # RK4 is stable up to h lambda = 2.78: an open valve at little pressure drop is slowed to 2
        stiff = -p[P.BRISTLE_STEP] * leg.flow_slope(p, x, P1, Ps) / leg.chamber_capacity(p, y, P1)
        rate /= max(1.0, 0.5 * stiff)
    act_dot[int(p[P.ACT_PRESSURE])] = rate / MPa
    return demand, heat


@compiled
def leg_bias(p, act, y, v, volts, t):
    """Force along the leg besides P1 A1 [N]."""
    _, P1, P2, Ps, z = leg_instant(p, act, volts, t)
    return leg.force_beyond_pressure(p, y, v, volts, P1, P2, Ps, z, t)


@compiled
def supply_state(p, act):
    """States of a power unit (6 numbers, places U) from MuJoCo's act: SI units."""
    k = int(p[S.ACT])
    return act[k], act[k + 1], act[k + 2], act[k + 3] * MPa, act[k + 4], act[k + 5] * MPa


@compiled
def supply_rates(p, act, act_dot, switched_on, demand, heat):
    """Write the rates of the supply's states into act_dot; return that of Ps [MPa/s]."""
    k = int(p[S.ACT])
    if p[S.MODEL] == supply.POWER_UNIT:
        speed, flow, line_flow, pump_pressure, temperature, pressure = supply.power_unit_rates(
            p, supply_state(p, act), switched_on, demand, heat
        )
        act_dot[k], act_dot[k + 1], act_dot[k + 2] = speed, flow, line_flow
        act_dot[k + 3], act_dot[k + 4], act_dot[k + 5] = pump_pressure / MPa, temperature, pressure / MPa
        return pressure / MPa
    nominal = switched_on * p[S.PRESSURE]
    pressure = act[k] * MPa
    rate = supply.line_rate(p, pressure, demand, nominal, supply.line_capacity(p, pressure)) / MPa
    act_dot[k] = rate
    return rate


@cache
def _compile() -> tuple:
    """The two native functions; they hold the places of the structs' fields as constants."""
    user_slot = slot("mjModel", "actuator_user")
    time_slot, ctrl_slot, act_slot = slot("mjData", "time"), slot("mjData", "ctrl"), slot("mjData", "act")
    rate_slot, userdata_slot = slot("mjData", "act_dot"), slot("mjData", "userdata")
    length_slot, velocity_slot = slot("mjData", "actuator_length"), slot("mjData", "actuator_velocity")
    signature = types.float64(types.voidptr, types.voidptr, types.int32)

    @cfunc(signature, error_model="numpy")
    def act_dyn(model, data, i):
        words = carray(data, (_WORDS,), types.uintp)
        user = _doubles(carray(model, (_WORDS,), types.uintp)[user_slot])
        p = _offset(user, i * N_PARAMETERS)
        act = _doubles(words[act_slot])
        act_dot = _doubles(words[rate_slot])
        ctrl = _doubles(words[ctrl_slot])
        from_legs = _doubles(words[userdata_slot])
        if p[P.ACT_PRESSURE] == SUPPLY_MARK:
            demand, heat = 0.0, 0.0
            for k in range(i):
                demand += from_legs[2 * k]
                heat += from_legs[2 * k + 1]
            return supply_rates(p, act, act_dot, ctrl[i], demand, heat)
        t = carray(data, (_WORDS,), types.float64)[time_slot]
        y = _doubles(words[length_slot])[i] - p[P.LENGTH_OFFSET]
        v = _doubles(words[velocity_slot])[i]
        from_legs[2 * i], from_legs[2 * i + 1] = leg_rates(p, act, act_dot, y, v, ctrl[i], t)
        return act_dot[int(p[P.ACT_PRESSURE])]

    @cfunc(signature, error_model="numpy")
    def act_bias(model, data, i):
        words = carray(data, (_WORDS,), types.uintp)
        user = _doubles(carray(model, (_WORDS,), types.uintp)[user_slot])
        p = _offset(user, i * N_PARAMETERS)
        if p[P.ACT_PRESSURE] == SUPPLY_MARK:
            return 0.0
        t = carray(data, (_WORDS,), types.float64)[time_slot]
        y = _doubles(words[length_slot])[i] - p[P.LENGTH_OFFSET]
        v = _doubles(words[velocity_slot])[i]
        return leg_bias(p, _doubles(words[act_slot]), y, v, _doubles(words[ctrl_slot])[i], t)

    return act_dyn, act_bias


@overload(operator.getitem)
def _named_place(pointer, place):
    """pointer[P.NAME], as for an array."""
    if isinstance(pointer, types.CPointer) and isinstance(place, types.IntEnumMember):
        return lambda pointer, place: pointer[np.intp(place)]
    return None


@intrinsic
def _offset(typingctx, pointer, count):
    """pointer + count doubles."""
    signature = pointer(pointer, types.intp)

    def codegen(context, builder, signature, args):
        return builder.gep(args[0], [args[1]], source_etype=ir.DoubleType())

    return signature, codegen


@contextmanager
def native_hydraulics() -> Iterator[None]:
    """Install the callbacks, which are global to the process, and put back what was there.

    MuJoCo's warnings are kept from writing MUJOCO_LOG.TXT into the working folder: `Plant.check` reports them.
    """
    act_dyn, act_bias = _compile()
    before = mujoco.get_mjcb_act_dyn(), mujoco.get_mjcb_act_bias()
    warn_before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda text: None)
    mujoco.set_mjcb_act_dyn(_pointer(act_dyn))
    mujoco.set_mjcb_act_bias(_pointer(act_bias))
    try:
        yield
    finally:
        mujoco.set_mjcb_act_dyn(before[0])
        mujoco.set_mjcb_act_bias(before[1])
        mujoco.set_mju_user_warning(warn_before)


def _pointer(function) -> ctypes._CFuncPtr:
    return function.ctypes
