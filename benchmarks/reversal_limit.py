"""Limit and reached: bumps of the bench over delay, spool bandwidth and oil stiffness. `python benchmarks/reversal_limit.py`
writes docs/results/reversal_limit.json and docs/images/reversal_limit.png.

The limit is what of friction's reversal the valve cannot keep from the load: the oil of the pressure step takes time.
The load rides on the oil: resonance w, damping ratio zeta. Friction reverses by 2 F within `friction_s`, centred on t = 0.
The oil's force for it comes as a ramp over `delivery_s`, `late_s` after that. With S = 2 F/M and r = exp(-zeta w t) sin(w_d
t)/w_d, the integral of the acceleration's response to a step of force,

    a = S [ramp(t - late, delivery) - ramp(t, friction)],    ramp(t, T) = [r(t + T/2) - r(t - T/2)]/T

Linear: that the piston sticks for a moment is not in it. It makes the raw peak smaller than a's, not what is below 50 Hz.

With the declared friction, oil and valve; 40 kg, 0.05 m at 0.5 Hz, 24 s, figures from 14 s on, peaks from the fundamental. A
known delay moves no limit: the future is known.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import ArrayLike, NDArray

from hexsim.declaration import Machine
from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.scenarios import load_scenario
from hexsim.simulation import simulate
from hexsim.smoothness import band_limit

Array = NDArray[np.float64]
ROOT = Path(__file__).parents[1]
RESULT, PICTURE = (ROOT / "docs" / p / f"reversal_limit.{e}" for p, e in (("results", "json"), ("images", "png")))
AMPLITUDE_m, FREQUENCY_Hz, DURATION_s, FIGURES_FROM_s = 0.05, 0.5, 24.0, 14.0
# what is changed: its field, values, unit of the axis, value that stands as 1 there
SWEPT: dict[str, tuple[str, tuple[float, ...], float]] = {
    "delay [ms]": ("controller.computing_delay_ticks", (0.0, 1.0, 2.0, 3.0), 0.5),
    "spool bandwidth [Hz]": ("valve.spool_frequency_Hz", (20.0, 30.0, 45.0, 60.0, 100.0, 150.0), 1.0),
    "bulk modulus of the oil [GPa]": ("oil.bulk_modulus_Pa", (0.5e9, 0.8e9, 1.5e9, 3e9), 1e9),
}


def delivery_s(tick_s: float, spool_Hz: float, travel_V: float, voltage_max_V: float) -> float:
    """Shortest time in which a second-order spool goes from rest to rest over `travel_V`.

    A hold needs two ticks of volts for it; the valve's range takes 2 sqrt(travel/(w^2 range)), full volts one way and back.
    """
    return max(2.0 * tick_s, 2.0 * math.sqrt(travel_V / voltage_max_V) / (2 * math.pi * spool_Hz))


def acceleration(
    time_s: ArrayLike,
    *,
    step_m_s2: float,
    resonance_Hz: float,
    damping_ratio: float,
    delivery_s: float,
    friction_s: float,
    late_s: float = 0.0,
) -> Array:
    """The load's acceleration (n,) beyond the one asked for; step_m_s2: S, of either sign."""
    w = 2 * math.pi * resonance_Hz
    t, w_d = np.asarray(time_s, dtype=float), w * math.sqrt(1.0 - damping_ratio**2)

    def ramp(since: Array, width_s: float) -> Array:
        begun, over = np.maximum(since + 0.5 * width_s, 0.0), np.maximum(since - 0.5 * width_s, 0.0)
        r = [np.exp(-damping_ratio * w * x) * np.sin(w_d * x) / w_d for x in (begun, over)]
        return (r[0] - r[1]) / width_s

    return step_m_s2 * (ramp(t - late_s, delivery_s) - ramp(t, friction_s))


def peak_in_band(**reversal: float) -> float:
    """Largest of `acceleration` below 50 Hz [m/s2], with these arguments."""
    step_s, span_s = 2e-5, 0.6  # of the record that the peak is taken from; a third of it lies before the reversal
    t = np.arange(round(span_s / step_s)) * step_s - span_s / 3
    return float(np.abs(band_limit(t, acceleration(t, **reversal))).max())  # type: ignore[arg-type]


def limit_of(machine: Machine, late_s: float = 0.0) -> float:
    """Of a bench's leg at mid-stroke, from its declaration."""
    cylinder, friction, valve, mass = machine.cylinder, machine.friction, machine.valve, machine.load.moving_mass_kg
    area, acceleration = cylinder.area_bottom_m2, AMPLITUDE_m * (2 * math.pi * FREQUENCY_Hz) ** 2
    length = 0.5 * cylinder.stroke_m + cylinder.pipeline_volume_m3 / area
    w = math.sqrt(machine.oil.bulk_modulus_Pa * area / (length * mass))
    levels = [
        friction.coulomb_extend_N,
        friction.coulomb_retract_N,
        friction.static_extend_N,
        friction.static_retract_N,
    ]
    viscous = 0.5 * (friction.viscous_extend_N_s_m + friction.viscous_retract_N_s_m)
    crossed = 2.0 * valve.overlap_m / valve.spool_travel_max_m * valve.voltage_max_V
    delivered = delivery_s(1.0 / machine.controller.rate_Hz, valve.spool_frequency_Hz, crossed, valve.voltage_max_V)
    return peak_in_band(
        step_m_s2=sum(levels) / mass,
        resonance_Hz=w / (2 * math.pi),
        damping_ratio=0.5 * viscous / (mass * w),
        delivery_s=delivered,
        friction_s=2.0 * friction.sharpness_m_s / acceleration,
        late_s=late_s,
    )


def reached(machine: Machine, name: str) -> float:
    """Peak in the band, worst of two noise seeds."""
    scenario = load_scenario("heave", amplitude=AMPLITUDE_m, frequency_Hz=FREQUENCY_Hz, duration_s=DURATION_s)
    scenario = dataclasses.replace(scenario, figures_from_s=FIGURES_FROM_s)
    runs = [simulate(machine, scenario, compensator=name, fast=True, seed=seed) for seed in (0, 1)]
    return max(run.summary["axes"]["leg"]["peak_band_m_s2"] for run in runs)


def measured() -> list[dict[str, Any]]:
    rows = []
    for axis, (field, values, _) in SWEPT.items():
        for value in values:
            machine = changed(load_machine("bench"), {field: value})
            found = {name: reached(machine, name) for name in ("none", "adaptive")}
            found |= {"limit": limit_of(machine), "limit, 1 ms late": limit_of(machine, 1e-3)}
            rows.append({"axis": axis, "value": value, **{name: round(peak, 4) for name, peak in found.items()}})
            print(rows[-1], flush=True)
    return rows


def picture(rows: list[dict[str, Any]], path: Path) -> None:
    looks = {
        "none": ("#888888", "o-"),
        "adaptive": ("#2060b0", "o-"),
        "limit": ("#c03020", "-"),
        "limit, 1 ms late": ("#c03020", "--"),
    }
    names = {"none": "plain control", "limit": "limit", "limit, 1 ms late": "the same, oil 1 ms late"}
    figure, plots = plt.subplots(1, len(SWEPT), figsize=(9.6, 3.6), sharey=True, layout="constrained")
    for plot, (axis, (_, _, unit)) in zip(plots, SWEPT.items(), strict=True):
        mine = [row for row in rows if row["axis"] == axis]
        at = np.array([row["value"] for row in mine]) / unit
        for name, (colour, style) in looks.items():
            plot.plot(at, [row[name] for row in mine], style, color=colour, ms=3, label=names.get(name, name))
        plot.set(yscale="log", xlabel=axis)
        plot.grid(color="#dddddd", lw=0.6, which="both")
    plots[0].set_ylabel("peak in 50 Hz [m/s²]")
    plots[1].legend(fontsize=7, loc="center right", bbox_to_anchor=(1.0, 0.68))
    figure.savefig(path, dpi=110)
    plt.close(figure)


def main() -> None:
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    rows = measured()
    RESULT.write_text(json.dumps(rows, indent=0) + "\n", encoding="utf-8")
    picture(rows, PICTURE)


if __name__ == "__main__":
    main()
