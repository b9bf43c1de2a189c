"""A leg drawn from a seed, and what its data sheet says of it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from types import SimpleNamespace
from typing import Any

import numpy as np

from benchmarks.grid import plant, priors
from compensation import Context
from compensation.volts_bound import edge_V

FAMILIES = ("reality", "wide", "single")
DECLARED = ("nothing", "sheet", "right")
# Relative uncertainty of a sheet's number, uniform half width or, where it is a factor, of its logarithm.
SHEET = {
    "supply": 0.02,
    "pipeline": 0.3,
    "position noise": math.log(2.0),
    "pressure noise": math.log(2.0),
    "spool": 0.15,
    "damping": 0.25,
    "stribeck": math.log(2.0),
    "edge": 0.3,
    "velocity gain": 0.15,
}


@dataclass(frozen=True)
class Leg:
    """One draw. numbers: (1,) record of `priors.LAYOUT`; context: what a compensator is given; pieces: steps a tick."""

    family: str
    seed: int
    numbers: np.ndarray
    context: Context
    declared: str
    name: str = ""
    pieces: int = 80

    @cached_property
    def c(self) -> Any:
        """The true numbers by name: `leg.c.spool_Hz`."""
        return SimpleNamespace(**self.truth)

    @cached_property
    def truth(self) -> dict[str, float]:
        """The true numbers as a table."""
        return {name: float(self.numbers[name][0]) for name in priors.LAYOUT.names or ()}


def draw_leg(
    seed: int,
    family: str = "reality",
    *,
    four_way: bool = False,
    declared: str = "nothing",
    changes: dict[str, float] | None = None,
) -> Leg:
    """The leg of a seed. family `single`: row `seed` of `priors.SINGLE`. declared: `nothing` but geometry, gain and supply; `sheet`:
    every number within its stated uncertainty; `right`: the truth. changes: numbers set in place of the draw."""
    if family not in FAMILIES or declared not in DECLARED:
        raise ValueError(f"family {family!r}, declared {declared!r}: give one of {FAMILIES} and one of {DECLARED}")
    random, name = np.random.default_rng([seed, FAMILIES.index(family), 39]), ""
    if family == "single":
        name, values = list(priors.SINGLE.items())[seed % len(priors.SINGLE)]
        values = dict(values)
    else:
        values = priors.drawn(family, random)
    ratio = float(random.uniform(priors.TOP_m2 / priors.BOTTOM_m2, 1.0))
    values["four_way"] = float(four_way)
    if four_way:  # a rod of 0 to 30 mm, and a load that both pressures can carry
        values["area_top_m2"] = priors.BOTTOM_m2 * (ratio if family != "single" else 1.0)
    numbers = priors.one_row(values | (changes or {}))
    leg = Leg(family, seed, numbers, Context(), declared, name)
    return Leg(
        family,
        seed,
        numbers,
        sheet_of(leg.c, declared, np.random.default_rng([seed, 41])),
        declared,
        name,
        plant.pieces_of(leg.c),
    )


def sheet_of(c: Any, declared: str, random: np.random.Generator) -> Context:
    """The data sheet of the numbers c."""
    known: dict[str, Any] = {
        "position_gain_V_per_m": float(c.gain_V_m),
        "stroke_m": float(c.stroke_m),
        "area_bottom_m2": float(c.area_bottom_m2),
        "area_top_m2": float(c.area_top_m2),
        "four_way": bool(c.four_way > 0.5),
        "supply_pressure_Pa": 7e6,
        "pipeline_volume_top_m3": 5e-7 if c.four_way > 0.5 else 0.0,
    }
    if declared == "nothing":
        return Context(**known)
    off = {
        name: (1.0 + share * random.uniform(-1, 1) if share < 0.5 else math.exp(share * random.uniform(-1, 1)))
        if declared == "sheet"
        else 1.0
        for name, share in SHEET.items()
    }
    drop_Pa = 0.5 * c.supply_Pa
    flow = plant.DISCHARGE * math.pi * plant.SPOOL_DIAMETER_m * plant.TRAVEL_m_V * math.sqrt(2.0 * drop_Pa / c.density)
    gain = float(flow / c.area_bottom_m2 * (1.0 - abs(c.port_skew)))
    level = c.friction * (c.coulomb_up_N + c.static_up_N + c.coulomb_down_N + c.static_down_N)
    edge = edge_V(
        (abs(c.overlap_m) + abs(c.edge_skew_m)) / plant.TRAVEL_m_V,
        c.rounding_m * max(1.0, c.rounding_ratio) / plant.TRAVEL_m_V,
        c.backlash_V,
        abs(c.null_V),
        (c.leak_supply_1 + c.leak_1_tank + c.leak_piston) * c.supply_Pa / c.area_bottom_m2,
        level / c.area_bottom_m2,
        (0.1 + c.dead_m3 / c.area_bottom_m2) / c.bulk_Pa,
        gain,
    )
    noise_V = 4.0 * c.gain_V_m * math.hypot(c.position_noise_m, c.position_resolution_m)
    known |= {
        "supply_pressure_Pa": float(c.supply_Pa * off["supply"]),
        "bulk_modulus_Pa": float(c.bulk_Pa) if declared == "right" else 1.5e9,  # a sheet knows neither air nor hoses
        "pipeline_volume_m3": float(c.dead_m3 * off["pipeline"]),
        "pipeline_volume_top_m3": float(c.dead_top_m3 * off["pipeline"]) if c.four_way > 0.5 else 0.0,
        "position_noise_m": float(c.position_noise_m * off["position noise"]),
        "position_resolution_m": float(c.position_resolution_m),
        "pressure_noise_Pa": float(c.pressure_noise_Pa * off["pressure noise"]),
        "pressure_resolution_Pa": float(c.pressure_resolution_Pa),
        "spool_damping": float(c.damping * off["damping"]),
        "spool_frequency_Hz": float(c.spool_Hz * off["spool"]),
        "stribeck_velocity_m_s": float(c.stribeck_m_s * off["stribeck"]),
        "edge_V": max(float(edge * off["edge"]), float(noise_V)),
        "velocity_gain_m_s_V": gain * off["velocity gain"],
    }
    return Context(**known)
