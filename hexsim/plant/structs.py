# pyright: reportAttributeAccessIssue=false
# (MuJoCo's bindings carry no types)
"""Where the fields of mjModel and mjData stand, so that native code can read them.

The places come from MuJoCo's own description of its structs (`mujoco.introspect`) and are compared at start-up with
the live numpy views; a wheel with another layout ends in a clear error and never in corrupt memory.
"""

from __future__ import annotations

import ctypes
from functools import cache

import mujoco
import numpy as np
from mujoco.introspect.structs import STRUCTS

from hexsim.errors import HexsimError

_SCALARS = {
    "int": ctypes.c_int,
    "mjtBool": ctypes.c_ubyte,
    "mjtByte": ctypes.c_ubyte,
    "mjtSize": ctypes.c_int64,
    "size_t": ctypes.c_size_t,
    "uintptr_t": ctypes.c_void_p,
    "uint64_t": ctypes.c_uint64,
    "mjtNum": ctypes.c_double,
    "double": ctypes.c_double,
    "float": ctypes.c_float,
    "unsigned int": ctypes.c_uint,
    "char": ctypes.c_char,
}


def _ctype(kind) -> type:
    """The ctypes type of a field's declaration."""
    name = type(kind).__name__
    if name == "PointerType":
        return ctypes.c_void_p
    if name == "ArrayType":
        inner = _ctype(kind.inner_type)
        for extent in reversed(kind.extents):
            inner = inner * extent
        return inner
    if name == "AnonymousStructDecl":
        return _structure("anonymous", kind.fields)
    if kind.name in _SCALARS:
        return _SCALARS[kind.name]
    if kind.name in STRUCTS:
        return _structure(kind.name, STRUCTS[kind.name].fields)
    return ctypes.c_int  # enumerations


def _structure(name: str, fields) -> type:
    members = [(field.name, _ctype(field.type)) for field in fields]
    return type(name, (ctypes.Structure,), {"_fields_": members})


@cache
def slot(struct: str, field: str) -> int:
    """Place of `field` in `struct`, counted in 8-byte words."""
    offset = getattr(_structure(struct, STRUCTS[struct].fields), field).offset
    if offset % 8:
        raise HexsimError(
            f"{struct}.{field} is not aligned to 8 bytes in mujoco {mujoco.__version__}: install mujoco 4.0.x"
        )
    return offset // 8


DATA_ARRAYS = ("ctrl", "act", "act_dot", "actuator_length", "actuator_velocity", "userdata")


def timestep_view(model: mujoco.MjModel) -> np.ndarray:
    """The model's time step [s] as an array (1,) that shares its memory."""
    place = model._address + 8 * (slot("mjModel", "opt") + slot("mjOption", "timestep"))
    return np.ctypeslib.as_array(ctypes.c_double.from_address(place)).reshape(1)


def time_view(data: mujoco.MjData) -> np.ndarray:
    """The data's time [s] as an array (1,) that shares its memory."""
    return np.ctypeslib.as_array(ctypes.c_double.from_address(data._address + 8 * slot("mjData", "time"))).reshape(1)


def check_layout(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Compare every place that native code uses with the live views. Raises HexsimError on the first difference."""
    views: list[tuple[str, str, int, np.ndarray]] = [
        ("mjData", name, data._address, getattr(data, name)) for name in DATA_ARRAYS
    ]
    views.append(("mjModel", "actuator_user", model._address, model.actuator_user))
    for struct, name, base, view in views:
        found = ctypes.c_uint64.from_address(base + 8 * slot(struct, name)).value
        if view.size and found != view.ctypes.data:
            raise HexsimError(_differs(struct, name))
    width = ctypes.c_int64.from_address(model._address + 8 * slot("mjModel", "nuser_actuator")).value
    if width != model.nuser_actuator:
        raise HexsimError(_differs("mjModel", "nuser_actuator"))
    if timestep_view(model)[0] != model.opt.timestep:
        raise HexsimError(_differs("mjOption", "timestep"))
    before = data.time
    data.time = 0.123456789
    found_time = float(time_view(data)[0])
    data.time = before
    if found_time != 0.123456789:
        raise HexsimError(_differs("mjData", "time"))


def _differs(struct: str, name: str) -> str:
    return (
        f"mujoco {mujoco.__version__} keeps {struct}.{name} in another place than its own description says: "
        "install mujoco 4.0.x"
    )
