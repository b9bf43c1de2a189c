# pyright: reportAttributeAccessIssue=false, reportCallIssue=false, reportArgumentType=false, reportPrivateImportUsage=false
# (MuJoCo's bindings carry no types, and numba's intrinsics are called without their typing context)
"""Native control callbacks: MuJoCo calls the compiled hydraulics at every evaluation, no Python in between.

`mjcb_act_dyn` gives the rates of each actuator's states (the last one is the pressure), `mjcb_act_bias` what acts along
the leg besides P1 A1, which is MuJoCo's linear gain on the last state.
Inside MuJoCo the states of chambers are in MPa (it rejects rates above 1e10); everywhere else they are in Pa. They are
pressures where oil fills the chamber (`hydraulics.chamber`): readers take `leg_state`, `supply_state`, `pressures_of`.

All numbers come from the model (`actuator_user`: a leg's row, or the supply's, with its layout behind; the time step) and
all states from the data, so one pair of callbacks serves any number of models and threads, and stays installed. A model
that is no plant is left as it is without callbacks. `userdata[2 i]` and `userdata[2 i + 1]` carry leg i's demand and
heat to the supply.
"""

from __future__ import annotations

import ctypes
import operator
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

import mujoco
import numpy as np
from llvmlite import ir
from numba import carray, types
from numba.extending import intrinsic, overload

from hexsim.compiled import compiled, compiled_callback
from hexsim.errors import HexsimError
from hexsim.files.toml_files import SI
from hexsim.hydraulics import chamber, learned, leg, supply
from hexsim.hydraulics.parameters import N_PARAMETERS, P
from hexsim.hydraulics.supply import S
from hexsim.plant import states
from hexsim.plant.states import ROW, A
from hexsim.plant.structs import slot

MPa = SI["MPa"]  # [Pa]
POWER_UNIT_SCALE = np.array([1.0, 1.0, 1.0, MPa, 1.0, MPa])  # SI over what stands in act, places U
WORDS = 4096  # enough words of either struct to reach the fields that are read


@intrinsic
def doubles(typingctx, address):
    """An address as a pointer to doubles."""
    signature = types.CPointer(types.float64)(types.uintp)

    def codegen(context, builder, signature, args):
        return builder.inttoptr(args[0], ir.PointerType(ir.DoubleType()))

    return signature, codegen


def pressures_of(states: np.ndarray) -> np.ndarray:
    """Pressures [Pa] of chambers from their states in MuJoCo's act, of any shape."""
    return np.maximum(states * MPa, chamber.VAPOUR)


@compiled
def supply_pressure(p, places, act):
    """Ps [Pa]: the manifold's, or the constant supply of the report."""
    place = int(places[A.SUPPLY])
    return chamber.pressure(act[place] * MPa) if place >= 0 else p[P.SUPPLY_PRESSURE]


@compiled
def leg_state(places, act, Ps):
    """(P1, P2, x, x', z) of a leg from MuJoCo's act: SI units. A state that the leg has not is Ps or 0."""
    s1, s2, x, speed, z = chamber_state(places, act, Ps)
    return chamber.pressure(s1), chamber.pressure(s2), x, speed, z


@compiled
def chamber_state(places, act, Ps):
    """(s1, s2, x, x', z): as `leg_state`, with the states of the chambers."""
    P1 = act[int(places[A.PRESSURE])] * MPa
    P2 = act[int(places[A.ROD_SIDE])] * MPa if places[A.ROD_SIDE] >= 0.0 else Ps
    x = speed = z = 0.0
    if places[A.SPOOL] >= 0.0:
        x, speed = act[int(places[A.SPOOL])], act[int(places[A.SPOOL]) + 1]
    if places[A.BRISTLE] >= 0.0:
        z = act[int(places[A.BRISTLE])]
    return P1, P2, x, speed, z


@compiled
def memory_of(places, act):
    """What the learned term of a leg remembers; 0 where it has no such state."""
    return act[int(places[A.MEMORY])] if places[A.MEMORY] >= 0.0 else 0.0


@compiled
def leg_rates(p, places, act, act_dot, y, v, volts, t, h):
    """Write the rates of one leg's states into act_dot; return its demand on the supply [m3/s] and its heat [W]."""
    Ps = supply_pressure(p, places, act)
    state, memory = chamber_state(places, act, Ps), memory_of(places, act)
    P1, s2, z = chamber.pressure(state[0]), state[1], state[4]
    rates, x, flow = leg.leg_derivatives(p, y, v, volts, t, Ps, state, h, memory)
    demand, heat = 0.0, 0.0
    if places[A.SUPPLY] >= 0.0:  # before anything is written, so that the compiler shares terms with the rates
        demand = leg.supply_demand_in_step(p, y, v, x, P1, s2, Ps, h)
        heat = leg.heat(p, y, v, x, P1, s2, Ps, z, flow, demand, h, t)
    if places[A.SPOOL] >= 0.0:
        act_dot[int(places[A.SPOOL])], act_dot[int(places[A.SPOOL]) + 1] = rates[2], rates[3]
    if places[A.BRISTLE] >= 0.0:
        act_dot[int(places[A.BRISTLE])] = rates[4]
    if places[A.MEMORY] >= 0.0:
        act_dot[int(places[A.MEMORY])] = learned.memory_rate(p, y, v, volts, P1, Ps, t, memory)
    if places[A.ROD_SIDE] >= 0.0:
        act_dot[int(places[A.ROD_SIDE])] = rates[1] / MPa
    act_dot[int(places[A.PRESSURE])] = rates[0] / MPa
    return demand, heat


@compiled
def leg_bias(p, places, act, y, v, volts, t):
    """Force along the leg besides s1 A1 [N], which MuJoCo's gain gives."""
    Ps = supply_pressure(p, places, act)
    s1, s2, _, _, z = chamber_state(places, act, Ps)
    P1, P2 = chamber.pressure(s1), chamber.pressure(s2)
    force = leg.force_beyond_pressure(p, y, v, volts, P1, P2, Ps, z, t, memory_of(places, act))
    return force + (P1 - s1) * p[P.AREA_BOTTOM] if s1 < P1 else force


@compiled
def supply_state(places, act):
    """A power unit (6 numbers, places U) from MuJoCo's act: SI units, pressures. places: layout of the supply."""
    k = int(places[A.SUPPLY])
    pump, manifold = chamber.pressure(act[k + 3] * MPa), chamber.pressure(act[k + 5] * MPa)
    return act[k], act[k + 1], act[k + 2], pump, act[k + 4], manifold


@compiled
def supply_rates(p, places, act, act_dot, switched_on, demand, heat, h):
    """Write the rates of the supply's states into act_dot; return that of Ps [MPa/s]."""
    k = int(places[A.SUPPLY])
    if p[S.MODEL] == supply.POWER_UNIT:
        state = (act[k], act[k + 1], act[k + 2], act[k + 3] * MPa, act[k + 4], act[k + 5] * MPa)
        speed, flow, line_flow, pump_pressure, temperature, pressure = supply.power_unit_rates(
            p, state, switched_on, demand, heat
        )
        act_dot[k], act_dot[k + 1], act_dot[k + 2] = speed, flow, line_flow
        act_dot[k + 3], act_dot[k + 4], act_dot[k + 5] = pump_pressure / MPa, temperature, pressure / MPa
        return pressure / MPa
    rate = 0.0
    if p[S.MODEL] == supply.LINE:
        rate = supply.line_rate(p, act[k] * MPa, demand, switched_on * p[S.PRESSURE], h) / MPa
    act_dot[k] = rate
    return rate


@cache
def native_callbacks() -> tuple:
    """The two native functions; they hold the places of the structs' fields as constants."""
    width_slot, user_slot = slot("mjModel", "nuser_actuator"), slot("mjModel", "actuator_user")
    step_slot = slot("mjModel", "opt") + slot("mjOption", "timestep")
    time_slot, ctrl_slot, act_slot = slot("mjData", "time"), slot("mjData", "ctrl"), slot("mjData", "act")
    rate_slot, userdata_slot = slot("mjData", "act_dot"), slot("mjData", "userdata")
    length_slot, velocity_slot = slot("mjData", "actuator_length"), slot("mjData", "actuator_velocity")
    signature = types.float64(types.voidptr, types.voidptr, types.int32)
    of_leg, of_supply = states.LEG, states.SUPPLY

    @compiled_callback(signature)
    def act_dyn(model, data, i):
        fields, words = carray(model, (WORDS,), types.uintp), carray(data, (WORDS,), types.uintp)
        if fields[width_slot] != ROW:
            return 0.0
        p = offset(doubles(fields[user_slot]), i * ROW)
        places = offset(p, N_PARAMETERS)
        act, act_dot, ctrl = doubles(words[act_slot]), doubles(words[rate_slot]), doubles(words[ctrl_slot])
        from_legs = doubles(words[userdata_slot])
        h = carray(model, (WORDS,), types.float64)[step_slot]
        if places[A.OWNER] == of_supply:
            demand, heat = 0.0, 0.0
            for k in range(i):
                demand += from_legs[2 * k]
                heat += from_legs[2 * k + 1]
            return supply_rates(p, places, act, act_dot, ctrl[i], demand, heat, h)
        if places[A.OWNER] != of_leg:
            return 0.0
        t = carray(data, (WORDS,), types.float64)[time_slot]
        y = doubles(words[length_slot])[i] - p[P.LENGTH_OFFSET]
        v = doubles(words[velocity_slot])[i]
        from_legs[2 * i], from_legs[2 * i + 1] = leg_rates(p, places, act, act_dot, y, v, ctrl[i], t, h)
        return act_dot[int(places[A.PRESSURE])]

    @compiled_callback(signature)
    def act_bias(model, data, i):
        fields, words = carray(model, (WORDS,), types.uintp), carray(data, (WORDS,), types.uintp)
        if fields[width_slot] != ROW:
            return 0.0
        p = offset(doubles(fields[user_slot]), i * ROW)
        places = offset(p, N_PARAMETERS)
        if places[A.OWNER] != of_leg:
            return 0.0
        t = carray(data, (WORDS,), types.float64)[time_slot]
        y = doubles(words[length_slot])[i] - p[P.LENGTH_OFFSET]
        v = doubles(words[velocity_slot])[i]
        return leg_bias(p, places, doubles(words[act_slot]), y, v, doubles(words[ctrl_slot])[i], t)

    return act_dyn, act_bias


@overload(operator.getitem)
def _named_place(pointer, place):
    """pointer[P.NAME], as for an array."""
    if isinstance(pointer, types.CPointer) and isinstance(place, types.IntEnumMember):
        return lambda pointer, place: pointer[np.intp(place)]
    return None


@intrinsic
def pointer_to(typingctx, array):
    """The first of a C-contiguous array's doubles: with it the equations are compiled once, for the callbacks and for arrays.
    The array's owner must hold it."""
    signature = types.CPointer(types.float64)(array)

    def codegen(context, builder, signature, args):
        return context.make_array(signature.args[0])(context, builder, value=args[0]).data

    return (signature, codegen) if array.dtype == types.float64 and array.layout == "C" else None


@intrinsic
def offset(typingctx, pointer, count):
    """pointer + count doubles."""
    signature = pointer(pointer, types.intp)

    def codegen(context, builder, signature, args):
        return builder.gep(args[0], [args[1]], source_etype=ir.DoubleType())

    return signature, codegen


_CALLBACKS = ("mjcb_act_dyn", "mjcb_act_bias")
_installing = threading.Lock()


def installed() -> bool:
    """Whether MuJoCo calls the hydraulics at present."""
    return all(_callback(name).value == made.address for name, made in zip(_CALLBACKS, native_callbacks(), strict=True))


def install_hydraulics() -> None:
    """Have MuJoCo call the hydraulics, once and for good: its callbacks are global to the process.

    They serve every plant in every thread and touch no other model. Raises HexsimError where another program in this
    process has callbacks of its own.
    """
    with _installing:
        for name, made in zip(_CALLBACKS, native_callbacks(), strict=True):
            if _callback(name).value not in (None, made.address):
                raise HexsimError(
                    f"MuJoCo's callback {name} belongs to another program in this process: hexsim needs it; run hexsim "
                    "in a process of its own"
                )
            getattr(mujoco, f"set_{name}")(made.ctypes)


@cache
def _callback(name: str) -> ctypes.c_void_p:
    """One of MuJoCo's global callbacks, where MuJoCo has it."""
    return ctypes.c_void_p.in_dll(ctypes.CDLL(mujoco._functions.__file__), name)


_untimed: list[int | None] = []  # clock that MuJoCo had, one entry for each run that does without


@contextmanager
def without_timers() -> Iterator[None]:
    """While a run lasts MuJoCo reads no clock for `mjData.timer`: thirty readings a step, a seventh of its time.

    The clock comes back when the last of several runs (in threads) ends.
    """
    clock = _callback("mjcb_time")
    with _installing:
        _untimed.append(_untimed[0] if _untimed else clock.value)
        clock.value = None
    try:
        yield
    finally:
        with _installing:
            kept = _untimed.pop()
            if not _untimed:
                clock.value = kept
