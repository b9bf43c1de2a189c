"""Why Kp = 50 V/m: tracking, peaks and margin over the gain. `python benchmarks/position_gain.py` writes docs/results/position_gain.md.

The loop is an integrator (velocity gain Kv = 0.15 m/s/V) with an oil resonance of little damping. A P loop is stable while
Kp Kv < 2 zeta omega of the weakest resonance; the table shows where that is for the machine as it is, valve and friction included.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from rich.progress import track

from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.scenarios import load_scenario
from hexsim.simulation import simulate
from hexsim.smoothness import band_limit

GAINS_V_per_m = (25, 50, 75, 100, 150, 200, 300, 400)
RESULT = Path(__file__).parents[1] / "docs" / "results" / "position_gain.md"
REASON = """The default of 50 V/m is the report's gain (its loop: 7.5 rad/s). A higher gain tracks better and makes the reversal bump
larger, because the loop crosses the dead band faster; half the gain saves a quarter of the bump and doubles the lag. Nothing
rings in mid-stroke up to 400 V/m: the open valve damps the oil."""


def row(gain: float) -> list[str]:
    """Heave and roll figures at one gain, and how the oil rings where the platform moves fastest, far from reversals."""
    machine = changed(load_machine("micro_motion_system"), {"controller.gain_V_per_m": gain})
    heave = simulate(machine, load_scenario("heave", duration_s=8.0), fast=True)
    roll = simulate(machine, load_scenario("roll", duration_s=8.0), fast=True)
    time, acceleration = heave.log["time_s"].to_numpy(), heave.log["true_acceleration_z_m_s2"].to_numpy()
    ringing = acceleration - band_limit(time, acceleration, 8.0)
    fast_part = (np.abs(heave.log["platform_z_m"].to_numpy()) < 0.015) & (time > 4.0) & (time < 7.9)
    z, r = heave.summary["axes"]["z"], roll.summary["axes"]["roll"]
    cells = [
        f"{gain:g}",
        f"{1e3 * np.mean(heave.summary['tracking_rms_m']):.1f}",
        f"{z['peak_band_m_s2']:.2f}",
        f"{r['peak_band_rad_s2']:.2f}",
        f"{np.std(ringing[fast_part]):.3f}",
    ]
    return cells


def main() -> None:
    lines = [
        "| Kp [V/m] | tracking rms, heave [mm] | heave peak [m/s2] | roll peak [rad/s2] | ringing in mid-stroke, rms above 8 Hz [m/s2] |",
        "|---|---|---|---|---|",
    ]
    lines += ["| " + " | ".join(row(gain)) + " |" for gain in track(GAINS_V_per_m, description="gains")]
    text = "\n".join(lines)
    RESULT.parent.mkdir(parents=True, exist_ok=True)
    RESULT.write_text(
        "# Position gain\n\n"
        "`python benchmarks/position_gain.py`. 600 kg, "
        f"0.05 m or 4 deg at 0.5 Hz, tendon model, 50 Hz band.\n\n{text}\n\n{REASON}\n"
    )
    print(text)


if __name__ == "__main__":
    main()
