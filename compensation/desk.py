# pyright: reportPrivateImportUsage=false, reportCallIssue=false
# (numba does not list its own functions, and intrinsics are called without their typing context)
"""All legs of a machine at one tick for native code: a table of addresses, `LEGS`, that a control tick without Python fills and reads.

`Desk` holds the arrays of `legs.Legs` in place, and the addresses of them. A tick of all legs is a C function void f(LEGS*, int what):
STEP takes `acts` (n,) and leaves `added_V` and `finite`; SHARE lets those legs that act tell the others what they have learned.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import carray, types
from numba.extending import intrinsic

from .compiled import views
from .records import record

STEP, SHARE = range(2)  # what is asked of a tick
SIZES = (  # legs; columns of preview, loads, mobility; forces; of a state, and of a row beside it
    "n", "most", "loads", "mobilities", "feels", "size", "width",
)  # fmt: skip
NUMBERS = ("time_s", "supply_Pa")
OF_LEGS = (
    "setpoint_m", "position_m", "control_V", "valve_V", "bottom_Pa", "top_Pa", "forward_V", "pose_m_s2", "added_V",
)  # fmt: skip
ADDRESSES = (
    *OF_LEGS, "preview_m", "loads_m_s2", "mobility", "forces_N", "speeds_m_s", "counts", "acts", "finite", "alike", "states", "table",
    "rows", "inner",
)  # fmt: skip
LEGS = record(**dict.fromkeys(SIZES + ADDRESSES, "i8"), **dict.fromkeys(NUMBERS, "f8"))
TICK = types.void(types.voidptr, types.int32)


@intrinsic
def pointer(typingctx: Any, address: Any) -> Any:  # type: ignore[misc]
    """An address as a pointer."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.inttoptr(args[0], context.get_value_type(types.voidptr))

    return types.voidptr(types.int64), codegen


@intrinsic
def address(typingctx: Any, array: Any) -> Any:  # type: ignore[misc]
    """Where the numbers of an array lie, one after the other."""
    if array.layout != "C":
        raise TypeError(f"{array} does not lie in one piece")

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        data = context.make_array(array)(context, builder, args[0]).data
        return builder.ptrtoint(data, context.get_value_type(types.int64))

    return types.int64(array), codegen


@intrinsic
def call_tick(typingctx: Any, address: Any, desk: Any, what: Any) -> Any:  # type: ignore[misc]
    """Call a TICK at an address with a pointer to a LEGS."""

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        kind = ir.FunctionType(ir.VoidType(), [args[1].type, ir.IntType(32)])
        builder.call(builder.inttoptr(args[0], ir.PointerType(kind)), [args[1], builder.trunc(args[2], ir.IntType(32))])
        return context.get_dummy_value()

    return types.void(types.int64, types.voidptr, types.int64), codegen


@views
def doubles(address, n):
    """n doubles at an address."""
    return carray(pointer(address), (n,), np.float64)


@views
def rows(address, n, width):
    """n rows of doubles at an address."""
    return carray(pointer(address), (n, width), np.float64)


@views
def integers(address, n):
    """n integers at an address."""
    return carray(pointer(address), (n,), np.int64)


@views
def truths(address, n):
    """n truth values at an address."""
    return carray(pointer(address), (n,), np.bool_)


@views
def on_desk(address):
    """The LEGS at an address."""
    return carray(pointer(address), (1,), LEGS)[0]


@views
def legs_on(desk):
    """Of all n legs on a desk whose states are rows of doubles: states (n, size), acts, finite (n,), and what the report's algorithms
    read and leave, each (n,): added volts, control volts, valve's volts, position [m], bottom pressure [Pa]."""
    d = carray(desk, (1,), LEGS)[0]
    return (
        rows(d.states, d.n, d.size), truths(d.acts, d.n), truths(d.finite, d.n), doubles(d.added_V, d.n), doubles(d.control_V, d.n),
        doubles(d.valve_V, d.n), doubles(d.position_m, d.n), doubles(d.bottom_Pa, d.n),
    )  # fmt: skip


class Desk:
    """Arrays of n legs, and the record that says where they are. They are kept as long as the desk."""

    def __init__(self, n: int, most: int, loads: int, feels: bool, counts: np.ndarray, alike: np.ndarray) -> None:
        wide = n if feels else 0
        self.arrays: dict[str, np.ndarray] = {name: np.zeros(n) for name in OF_LEGS}
        self.arrays |= {
            "preview_m": np.zeros((n, most)),
            "loads_m_s2": np.zeros((n, loads)),
            "mobility": np.zeros((n, wide)),
            "forces_N": np.zeros(wide),
            "speeds_m_s": np.zeros(wide),
            "counts": np.array(counts, np.int64),
            "acts": np.zeros(n, bool),
            "finite": np.ones(n, bool),
            "alike": np.array(alike, bool),
        }
        self.record = np.zeros(1, LEGS)
        for name, size in zip(SIZES, (n, most, loads, wide, wide, 0, 0), strict=True):
            self.record[name] = size
        for name, array in self.arrays.items():
            self.record[name] = array.ctypes.data

    def place(self, states: np.ndarray, table: np.ndarray | None = None, rows: np.ndarray | None = None) -> None:
        """Where the states of the legs are, one a row, a table of constants, and rows of doubles beside the states."""
        self.record["size"] = states.strides[0] // 8
        for name, array in (("states", states), ("table", table), ("rows", rows)):
            if array is not None:
                self.arrays[name] = array
                self.record[name] = array.ctypes.data
        self.record["width"] = 0 if rows is None else rows.shape[1]
