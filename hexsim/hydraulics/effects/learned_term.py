"""Learned term: a curve in one balance over one signal, measured and not explained by any physical effect.

[effects.learned_term]
curve = {balance = "force", signal = "position_m", start = 0.0, step = 0.01, values = [0.0, ...]}   # 33 values
"""

from __future__ import annotations

from typing import Any

from hexsim.errors import HexsimError
from hexsim.hydraulics.effects.effect import Effect
from hexsim.hydraulics.learned import CONTINUITY, FORCE, SIGNALS
from hexsim.hydraulics.parameters import LEARNED_KNOTS, LEARNED_TABLE, P
from hexsim.hydraulics.resolved import Resolved

BALANCES = {"continuity": CONTINUITY, "force": FORCE}  # [m3/s], [N]


def apply(resolved: Resolved, legs: tuple[int, ...], values: dict[str, Any]) -> None:
    """Write the curve into the legs' rows. Raises HexsimError for a curve that is not one."""
    curve = values.get("curve")
    if not isinstance(curve, dict) or set(curve) != {"balance", "signal", "start", "step", "values"}:
        raise HexsimError("[effects.learned_term] curve needs balance, signal, start, step and values")
    if curve["balance"] not in BALANCES or curve["signal"] not in SIGNALS or not float(curve["step"]) > 0:
        allowed = f"balance {', '.join(BALANCES)}; signal {', '.join(SIGNALS)}; step > 0"
        raise HexsimError(f"[effects.learned_term] curve is not known: allowed are {allowed}")
    if len(curve["values"]) != LEARNED_KNOTS:
        raise HexsimError(f"[effects.learned_term] values has {len(curve['values'])} numbers: give {LEARNED_KNOTS}")
    for leg in legs:
        row = resolved.rows[leg]
        row[P.LEARNED_BALANCE] = BALANCES[curve["balance"]]
        row[P.LEARNED_SIGNAL] = SIGNALS.index(curve["signal"])
        row[P.LEARNED_START], row[P.LEARNED_STEP] = curve["start"], curve["step"]
        row[LEARNED_TABLE : LEARNED_TABLE + LEARNED_KNOTS] = curve["values"]


EFFECT = Effect(
    name="learned_term",
    balance="force",
    description="a measured curve in one balance over one signal, under no physical name",
    source="Kennedy and O'Hagan 2001; Ebers, Steele and Kutz 2024",
    parameters=(),
    apply=apply,
)
