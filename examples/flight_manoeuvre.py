"""A light aircraft's manoeuvre, flown by JSBSim, as a table that motion_cueing.py plays on the machine.

    python examples/flight_manoeuvre.py --out flight.csv
    python examples/motion_cueing.py --vehicle flight.csv --out flight

JSBSim's Cessna 172, trimmed at 100 kt and 3000 ft: pitch up and down, roll into a turn to the left and out of it, a yaw
doublet, idle and full throttle. `--turbulence` adds rough air (Milspec, its wind at 20 ft in ft/s).
Columns: time_s, the pilot's specific force less gravity at rest (forward, left, up [m/s2]) and the body's rates (roll,
pitch, yaw [rad/s]), axes forward, left, up; 120 rows a second. Needs `pip install jsbsim`.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import polars as pl
from scipy.constants import foot

from hexsim.cueing.protocols import NAMES
from hexsim.cueing.washout import g

try:
    import jsbsim
except ModuleNotFoundError:
    raise SystemExit("JSBSim is not installed: pip install jsbsim") from None

RATE_Hz = 120.0
DURATION_s = 40.0


def stick(time: float) -> dict[str, float]:
    """What the pilot moves, beside the trim, -1 to 1."""

    def doublet(start: float, length: float, size: float) -> float:
        phase = (time - start) / length
        return size * float(np.sin(2.0 * np.pi * phase)) if 0.0 < phase < 1.0 else 0.0

    return {
        "fcs/elevator-cmd-norm": doublet(3.0, 2.0, -0.12),
        "fcs/aileron-cmd-norm": doublet(9.0, 3.0, -0.25) - doublet(16.0, 3.0, -0.25),
        "fcs/rudder-cmd-norm": doublet(23.0, 2.0, 0.3),
        "fcs/throttle-cmd-norm": -0.5 if 28.0 < time < 32.0 else 0.2 if time > 32.0 else 0.0,
    }


def fly(turbulence_ft_s: float = 0.0) -> pl.DataFrame:
    """The manoeuvre from trimmed flight."""
    flight = jsbsim.FGFDMExec(jsbsim.get_default_root_dir())
    flight.set_debug_level(0)
    flight.load_model("c172p")
    flight.set_dt(1.0 / RATE_Hz)
    flight["ic/vc-kts"], flight["ic/h-sl-ft"] = 100.0, 3000.0
    flight.run_ic()
    flight["propulsion/set-running"] = -1
    flight["fcs/mixture-cmd-norm"] = 0.87
    flight["simulation/do_simple_trim"] = 1
    if turbulence_ft_s:
        flight["simulation/randomseed"] = 1
        flight["atmosphere/turb-type"] = 3
        flight["atmosphere/turbulence/milspec/windspeed_at_20ft_AGL-fps"] = turbulence_ft_s
        flight["atmosphere/turbulence/milspec/severity"] = 3
    trim = {name: flight[name] for name in stick(0.0)}
    start, rows = flight.get_sim_time(), []
    while (time := flight.get_sim_time() - start) < DURATION_s:
        for name, value in stick(time).items():
            flight[name] = trim[name] + value
        flight.run()
        x, y, z = (foot * flight[f"accelerations/a-pilot-{axis}-ft_sec2"] for axis in "xyz")
        p, q, r = (flight[f"velocities/{axis}-rad_sec"] for axis in "pqr")
        rows.append((time, x, -y, -z - g, p, -q, -r))
    table = np.array(rows)
    table[:, 1:4] -= table[0, 1:4]  # trimmed flight climbs a little nose up: its lean is where the ride begins
    return pl.DataFrame(dict(zip(("time_s", *NAMES), table.T, strict=True)))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("flight.csv"))
    parser.add_argument("--turbulence", type=float, default=0.0, help="wind at 20 ft [ft/s]: 15 light, 45 moderate")
    arguments = parser.parse_args()
    table = fly(arguments.turbulence)
    table.write_csv(arguments.out)
    print(table.select(pl.exclude("time_s")).describe())


if __name__ == "__main__":
    main()
