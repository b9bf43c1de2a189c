"""Makes ride.csv: the legs' strokes of a hexapod that follows a light aircraft in rough air, `python -m benchmarks.grid.ride`.

JSBSim's Cessna 172 flies examples/flight_manoeuvre.py in moderate turbulence; the washout of hexsim.cueing makes poses of it, the
600 kg machine's geometry strokes. Kept as a table, so that the grid needs neither: offsets from mid-stroke [um], a column a leg,
50 rows a second. Needs `pip install jsbsim`.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

TABLE = Path(__file__).with_name("ride.csv")
RATE_HZ, TURBULENCE_ft_s = 50.0, 45.0


def main() -> None:
    from hexsim.cueing.washout import Washout, poses
    from hexsim.machine import load_machine
    from hexsim.machine.geometry import machine_kinematics

    sys.path.insert(0, str(Path(__file__).parents[2] / "examples"))
    from flight_manoeuvre import fly  # pyright: ignore[reportMissingImports] (with the examples)

    flight = fly(TURBULENCE_ft_s).to_numpy()
    time = np.arange(0.0, flight[-1, 0], 2e-3)
    force, turning = (
        np.column_stack([np.interp(time, flight[:, 0], column) for column in flight[:, part].T])
        for part in (slice(1, 4), slice(4, 7))
    )
    machine = load_machine("micro_motion_system")
    strokes = machine_kinematics(machine).inverse(poses(Washout(), force, turning))
    offsets = strokes[:: round(500 / RATE_HZ)] - 0.5 * machine.cylinder.stroke_m
    np.savetxt(TABLE, np.round(1e6 * offsets), fmt="%d", delimiter=",")


if __name__ == "__main__":
    main()
