"""Learned term: a curve in one balance over one signal, measured and not explained by any physical effect.

[effects.learned_term]
curve = {balance = "force", signal = "position_m", start = 0.0, step = 0.01, values = [0.0, ...]}   # 33 values
form = "product" in it: the velocity times the curve; "direction": 16 values moving out, then 16 moving in
memory_s = 1.5 in it: the signal behind a first-order low-pass of this time constant
"""

from __future__ import annotations

from typing import Any

from hexsim.errors import HexsimError
from hexsim.hydraulics.effects.effect import Effect
from hexsim.hydraulics.learned import CONTINUITY, DIRECTION, FORCE, FORMS, HALF, SIGNALS
from hexsim.hydraulics.parameters import LEARNED_KNOTS, LEARNED_TABLE, P
from hexsim.hydraulics.resolved import Resolved

BALANCES = {"continuity": CONTINUITY, "force": FORCE}  # [m3/s], [N]


def apply(resolved: Resolved, legs: tuple[int, ...], values: dict[str, Any]) -> None:
    """Write the curve into the legs' rows. Raises HexsimError for a curve that is not one."""
    curve = values.get("curve")
    if not isinstance(curve, dict) or set(curve) - {"form", "memory_s"} != {
        "balance",
        "signal",
        "start",
        "step",
        "values",
    }:
        raise HexsimError("[effects.learned_term] curve needs balance, signal, start, step and values")
    form = curve.get("form", FORMS[0])
    known = curve["balance"] in BALANCES and curve["signal"] in SIGNALS and form in FORMS
    memory_s = float(curve.get("memory_s", 0.0))
    if not known or not float(curve["step"]) > 0 or not memory_s >= 0.0:
        allowed = f"balance {', '.join(BALANCES)}; signal {', '.join(SIGNALS)}; form {', '.join(FORMS)}; step > 0; memory_s >= 0"
        raise HexsimError(f"[effects.learned_term] curve is not known: allowed are {allowed}")
    count = 2 * HALF if FORMS.index(form) == DIRECTION else LEARNED_KNOTS
    if len(curve["values"]) != count:
        raise HexsimError(f"[effects.learned_term] values has {len(curve['values'])} numbers: give {count}")
    for leg in legs:
        row = resolved.rows[leg]
        row[P.LEARNED_BALANCE] = BALANCES[curve["balance"]]
        row[P.LEARNED_SIGNAL] = SIGNALS.index(curve["signal"])
        row[P.LEARNED_START], row[P.LEARNED_STEP] = curve["start"], curve["step"]
        row[P.LEARNED_FORM], row[P.LEARNED_MEMORY] = FORMS.index(form), memory_s
        row[LEARNED_TABLE : LEARNED_TABLE + count] = curve["values"]


EFFECT = Effect(
    name="learned_term",
    balance="force",
    description="a measured curve in one balance over one signal, under no physical name",
    source="Kennedy and O'Hagan 2001; Ebers, Steele and Kutz 2024",
    parameters=(),
    apply=apply,
    once=True,
)
