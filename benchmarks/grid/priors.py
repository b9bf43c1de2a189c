"""Every number of a leg: unit, nominal value, the draws of both families, and why.

`reality`: the ranges of the first drawn count (spool, damping, amplifier, noise, Stribeck, rounding, friction, oil, mass, overlap,
hysteresis, null, gain, bend, resolution of the volts), the rest nominal. `wide`: everything. A structure (bristles, air, droop,
slots, memory, skewed edges ...) that a leg need not have is there with a chance, else nominal.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Prior:
    """Uniform between low and high; of the logarithm for sizes known by their order; of whole numbers. chance: of being drawn."""

    low: float
    high: float
    chance: float = 1.0
    logarithmic: bool = False
    whole: bool = False

    def draw(self, random: np.random.Generator, nominal: float) -> float:
        """Takes two numbers of the generator whatever comes out, so that one row's change leaves the others' draws."""
        there, share = random.uniform(size=2)
        if there >= self.chance:
            return nominal
        if self.logarithmic:
            return math.exp(math.log(self.low) + share * math.log(self.high / self.low))
        value = self.low + share * (self.high - self.low + self.whole)
        return float(math.floor(value)) if self.whole else value

    @property
    def text(self) -> str:
        kind = " log" if self.logarithmic else ""
        share = "" if self.chance == 1.0 else f", {100 * self.chance:.0f} %"
        return f"{self.low:g} to {self.high:g}{kind}{share}"


def uniform(low: float, high: float, chance: float = 1.0) -> Prior:
    return Prior(low, high, chance)


def orders(low: float, high: float, chance: float = 1.0) -> Prior:
    return Prior(low, high, chance, logarithmic=True)


def whole(low: int, high: int, chance: float = 1.0) -> Prior:
    return Prior(low, high, chance, whole=True)


@dataclass(frozen=True)
class Number:
    """A row of the table."""

    name: str
    unit: str
    nominal: float
    reality: Prior | None
    wide: Prior | None
    reason: str


BOTTOM_m2 = math.pi / 4 * 0.04**2
TOP_m2 = math.pi / 4 * (0.04**2 - 0.03**2)

NUMBERS = (
    # load and supply
    Number(
        "mass_kg",
        "kg",
        50.0,
        uniform(51.0, 210.0),
        uniform(51.0, 210.0),
        "a leg's share of the load, people and equipment",
    ),
    Number("spring_N_m", "N/m", 0.0, None, uniform(-3e3, 3e3, 0.3), "the other legs' gravity, cables"),
    Number("supply_Pa", "Pa", 7e6, None, uniform(6.3e6, 7.7e6), "pump setting"),
    Number("line_Pa_s_m3", "Pa s/m3", 0.0, None, orders(1e8, 1.5e9, 0.5), "droop: at 0.2 l/s 0.02 to 0.3 MPa"),
    Number("accumulator_m3_Pa", "m3/Pa", 6e-12, None, orders(2e-12, 2e-11), "accumulator behind that line"),
    Number("return_Pa_s_m3", "Pa s/m3", 0.0, None, orders(1e7, 3e8, 0.5), "return line and filter"),
    # oil and chambers
    Number("four_way", "", 0.0, None, None, "1: the rod side is a chamber on the valve"),
    Number("area_bottom_m2", "m2", BOTTOM_m2, None, None, "piston of 40 mm"),
    Number("area_top_m2", "m2", TOP_m2, None, None, "rod of 30 mm; four-way: of 0 to 30 mm, drawn apart"),
    Number("stroke_m", "m", 0.2, None, None, ""),
    Number(
        "bulk_Pa",
        "Pa",
        1.5e9,
        uniform(0.75e9, 1.65e9),
        uniform(0.75e9, 1.65e9),
        "x 0.5 to 1.1 of the sheet: air, hoses, heat",
    ),
    Number("density", "kg/m3", 860.0, None, uniform(840.0, 880.0), "mineral oils, 20 to 50 degC"),
    Number("viscosity", "Pa s", 0.04, None, orders(0.015, 0.09), "VG 46 at 60 to 25 degC"),
    Number("dead_m3", "m3", 5e-7, None, orders(5e-7, 2e-5), "manifold and pipe"),
    Number("dead_top_m3", "m3", 5e-7, None, orders(5e-7, 2e-5), "the same of the rod side"),
    Number("hose_m3", "m3", 0.0, None, orders(1e-6, 3e-5, 0.4), "hose of 12 mm, 10 to 300 mm"),
    Number("hose_Pa", "Pa", 5e8, None, orders(2e8, 8e8), "its modulus with the oil in it"),
    Number("air", "", 0.0, None, orders(2e-3, 4e-2, 0.5), "free air, share of volume at 1 bar"),
    Number("polytropic", "", 1.2, None, uniform(1.0, 1.4), "isothermal to adiabatic"),
    Number("leak_supply_1", "m3/s/Pa", 0.0, None, orders(1e-13, 2.5e-12, 0.5), "valve, supply to bottom side"),
    Number("leak_1_tank", "m3/s/Pa", 0.0, None, orders(1e-13, 2.5e-12, 0.5), "bottom side to tank"),
    Number("leak_supply_2", "m3/s/Pa", 0.0, None, orders(1e-13, 2.5e-12, 0.5), "four-way only"),
    Number("leak_2_tank", "m3/s/Pa", 0.0, None, orders(1e-13, 2.5e-12, 0.5), "four-way only"),
    Number(
        "leak_piston",
        "m3/s/Pa",
        0.0,
        None,
        orders(1e-13, 2.5e-12, 0.5),
        "four-way only; a three-way leg's is leak_supply_1",
    ),
    # valve
    Number("spool_Hz", "Hz", 60.0, orders(30.0, 150.0), orders(25.0, 250.0), "proportional to servo valves"),
    Number("damping", "", 0.7, uniform(0.4, 1.2), uniform(0.4, 1.4), "of the spool"),
    Number(
        "amplifier_s",
        "s",
        0.0,
        orders(1e-4, 2e-3),
        orders(1e-4, 3e-3, 0.8),
        "current loop, pilot stage: the third order",
    ),
    Number("slew_V_s", "V/s", 1e4, None, orders(250.0, 2e3, 0.5), "full travel in 5 to 40 ms"),
    Number(
        "overlap_m",
        "m",
        5e-6,
        uniform(0.0, 2e-5),
        uniform(-5e-6, 4e-5),
        "110 um a volt: underlap 45 mV, overlap 0.36 V",
    ),
    Number("rounding_m", "m", 5e-7, orders(5e-7, 5e-6), orders(5e-7, 5e-6), "new to worn edges"),
    Number("rounding_ratio", "", 1.0, None, uniform(0.5, 2.0, 0.5), "tank edge over supply edge, worn unequally"),
    Number("edge_tail", "", 0.0, None, whole(0, 1), "0: closes exponentially, 1: as two round corners"),
    Number(
        "edge_skew_m",
        "m",
        0.0,
        None,
        uniform(-3e-6, 3e-6, 0.5),
        "of the supply edge's corner: overlaps unequal by 6 um",
    ),
    Number("port_skew", "", 0.0, None, uniform(-0.15, 0.15, 0.5), "gain of the supply edge over the tank edge"),
    Number(
        "land_m",
        "m",
        0.0,
        None,
        orders(2e-7, 5e-6, 0.6),
        "slot that viscosity sees; with it a nearly shut edge is laminar",
    ),
    Number("laminar_Pa", "Pa", 1e4, None, orders(1e3, 8e5), "below it any opening is laminar"),
    Number(
        "bend", "1/V", 0.0, uniform(-0.2, 0.3), uniform(-0.2, 0.4), "change of the gain by 1 V, twice that far away"
    ),
    Number(
        "backlash_V",
        "V",
        0.0,
        uniform(0.0, 0.03),
        uniform(0.0, 0.03),
        "half width; 0.3 % of the range is a sheet's figure",
    ),
    Number(
        "backlash_spread", "", 0.0, None, uniform(0.0, 0.6, 0.5), "share that a narrower play has: magnetic hysteresis"
    ),
    Number("null_V", "V", 0.0, uniform(-0.1, 0.1), uniform(-0.15, 0.15), "1 % of the range"),
    Number("null_drift_V_s", "V/s", 0.0, None, uniform(-1e-3, 1e-3, 0.5), "30 mV in a run"),
    Number("valve_delay_s", "s", 0.0, None, uniform(0.0, 4e-3, 0.7), "digital valve, fieldbus"),
    # friction
    Number("friction", "", 1.0, orders(0.5, 3.0), orders(0.5, 3.0), "all of it, over the report's"),
    Number("coulomb_up_N", "N", 65.0, None, uniform(45.0, 85.0), "of one direction alone"),
    Number("coulomb_down_N", "N", 60.0, None, uniform(45.0, 85.0), ""),
    Number("static_up_N", "N", 30.0, None, uniform(10.0, 50.0), "beyond Coulomb, at breakaway"),
    Number("static_down_N", "N", 30.0, None, uniform(10.0, 50.0), ""),
    Number("viscous_up_N_s_m", "N s/m", 2200.0, None, uniform(1400.0, 2800.0), ""),
    Number("viscous_down_N_s_m", "N s/m", 1800.0, None, uniform(1400.0, 2800.0), ""),
    Number("stribeck_m_s", "m/s", 5e-3, orders(2e-3, 1.5e-2), orders(2e-3, 1.5e-2), "over which it falls"),
    Number("sharpness_m_s", "m/s", 2e-4, None, orders(1e-4, 1e-3), "of the sign where there are no bristles"),
    Number("bristle_N_m", "N/m", 0.0, None, orders(1e6, 1e7, 0.6), "presliding stiffness of seals"),
    Number(
        "bristle_ratio", "", 1.0, None, uniform(1.0, 5.0), "stiffness of one bristle over the other's: memory of turns"
    ),
    Number("bristle_N_s_m", "N s/m", 1e3, None, orders(3e2, 2e3), "their damping"),
    Number("friction_lag_s", "s", 0.0, None, orders(1e-3, 2e-2, 0.4), "frictional memory"),
    Number("seal_N_Pa", "N/Pa", 0.0, None, orders(1e-6, 1e-5, 0.5), "Coulomb friction for P1"),
    Number("warming", "", 0.0, None, uniform(0.0, 0.15, 0.5), "friction lost with 20 s"),
    Number("tight_spot", "", 0.0, None, uniform(0.0, 0.3, 0.4), "more friction at mid-stroke, over 20 mm"),
    # computer and transducers
    Number("gain_V_m", "V/m", 50.0, orders(25.0, 100.0), orders(25.0, 100.0), "of the position loop"),
    Number("volts_bits", "bit", 16.0, whole(12, 16), whole(12, 16), "over 20 V: 4.9 to 0.3 mV"),
    Number("computer_delay_s", "s", 0.0, None, uniform(0.0, 2e-3, 0.5), "read to written"),
    Number("jitter_s", "s", 0.0, None, uniform(0.0, 3e-4, 0.5), "of the tick, either way"),
    Number("position_noise_m", "m", 3e-6, orders(1e-6, 1e-5), orders(1e-6, 2e-5), "standard deviation of a reading"),
    Number("position_resolution_m", "m", 3e-6, None, orders(5e-7, 1.2e-5), "18 to 14 bit of the stroke"),
    Number("position_colour", "", 0.0, None, uniform(0.0, 0.7, 0.4), "correlation of its noise from tick to tick"),
    Number("position_delay_s", "s", 0.0, None, uniform(0.0, 4e-3, 0.6), "transducer's cycle and bus"),
    Number("position_lag_s", "s", 0.0, None, orders(1e-4, 1e-3, 0.5), "its filter"),
    Number("ripple_m", "m", 0.0, None, orders(5e-7, 4e-6, 0.4), "its interpolation, over 2 mm"),
    Number("pressure_noise_Pa", "Pa", 4e3, orders(2e3, 3e4), orders(2e3, 3e4), "standard deviation of a reading"),
    Number("pressure_resolution_Pa", "Pa", 0.0, None, orders(2e2, 6e3, 0.7), "16 to 12 bit of 16 MPa"),
    Number("pressure_delay_s", "s", 0.0, None, uniform(0.0, 2e-3, 0.5), ""),
    Number("pressure_lag_s", "s", 0.0, None, orders(2e-4, 2e-3, 0.7), "transducer and its line"),
    Number("supply_delay_s", "s", 0.0, None, uniform(0.0, 2e-3, 0.5), ""),
    Number("supply_lag_s", "s", 0.0, None, orders(2e-4, 5e-3, 0.7), ""),
)
LAYOUT = np.dtype([(number.name, "f8") for number in NUMBERS])
NOMINAL = {number.name: number.nominal for number in NUMBERS}

# Each alone on the nominal leg: the published table of single variations.
SINGLE: dict[str, dict[str, float]] = {
    "as declared": {},
    **{f"spool damping {z:g}": {"damping": z} for z in (0.4, 0.5, 0.9, 1.0, 1.4)},
    **{f"spool {f:g} Hz": {"spool_Hz": f} for f in (25.0, 40.0, 100.0, 175.0, 225.0, 250.0)},
    **{f"position noise {1e6 * s:g} um": {"position_noise_m": s} for s in (6e-6, 1e-5, 2e-5)},
    "14 bit position": {"position_resolution_m": 1.2e-5},
    "edges worn round by 6 um": {"rounding_m": 6e-6},
    "gain bent +40 % by 1 V": {"bend": 0.4},
    "tick jitter 0.3 ms": {"jitter_s": 3e-4},
    "overlap 0": {"overlap_m": 0.0},
    "overlap 30 um": {"overlap_m": 3e-5},
    "oil half as stiff": {"bulk_Pa": 0.75e9},
    "Coulomb x 3": {"coulomb_up_N": 195.0, "coulomb_down_N": 180.0},
    "Stribeck 2 mm/s": {"stribeck_m_s": 2e-3},
    "12 bit volts": {"volts_bits": 12.0},
    "leak 2.5e-12 with edges rounded by 2 um": {"leak_supply_1": 2.5e-12, "rounding_m": 2e-6},
    "60 mV hysteresis": {"backlash_V": 0.06},
    "laminar below 2 bar": {"laminar_Pa": 2e5},
    "laminar below 8 bar": {"laminar_Pa": 8e5},
    "pressure lag 2 ms": {"pressure_lag_s": 2e-3, "supply_lag_s": 2e-3},
    "loop gain 20": {"gain_V_m": 20.0},
    "loop gain 120": {"gain_V_m": 120.0},
    "soft friction": {"sharpness_m_s": 1e-3},
}


def one_row(values: dict[str, float]) -> np.ndarray:
    """(1,) record of LAYOUT; what is not given is nominal."""
    numbers = np.zeros(1, LAYOUT)
    for name, value in (NOMINAL | values).items():
        numbers[name] = value
    return numbers


def table() -> str:
    """The priors as Markdown."""
    lines = ["| number | unit | nominal | reality | wide | reason |", "|---|---|---|---|---|---|"]
    for n in NUMBERS:
        cells = (n.name, n.unit, f"{n.nominal:.4g}", *(p.text if p else "" for p in (n.reality, n.wide)), n.reason)
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def drawn(family: str, random: np.random.Generator) -> dict[str, Any]:
    """Values by name of one leg."""
    return {n.name: prior.draw(random, n.nominal) for n in NUMBERS if (prior := getattr(n, family)) is not None}
