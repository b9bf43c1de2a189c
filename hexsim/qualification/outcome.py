"""What came of a fault, read from a run: detection, reaction, peak acceleration, time to rest, use of the end stops."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hexsim.errors import HexsimError
from hexsim.signals.table import table
from hexsim.simulation import Run


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """Times count from the fault.

    detected_s: first error found (None: none); description: its text. state: the motion computer's at the end.
    peak_acceleration_m_s2: of the platform's origin, no band limit; before_m_s2: the same before the fault.
    rest_s: from here on no piston moves (None: still moving at the end).
    lowest_m, highest_m: piston positions from the fault on, 0 and stroke are the ends; final_m: where the legs stand.
    """

    detected_s: float | None
    description: str
    state: str
    peak_acceleration_m_s2: float
    before_m_s2: float
    rest_s: float | None
    lowest_m: float
    highest_m: float
    final_m: tuple[float, ...]


def outcome(
    run: Run,
    time_s: float,
    settled_s: float = 1.0,
    *,
    still_m_s: float = 2.0e-3,  # a piston slower than this is at rest
) -> Outcome:
    """The outcome of the fault at `time_s`; the run's first `settled_s` do not count as "before"."""
    if "motion_computer" not in run.summary:
        raise HexsimError(f"scenario {run.scenario.name} has no faults: there is no outcome to read")
    log, n = run.log, run.machine.n_legs
    time = log["time_s"].to_numpy()
    late = time >= time_s
    position, velocity = (
        log.select(table()[stem].columns(n)).to_numpy(order="c") for stem in ("true_position", "velocity")
    )
    names = table()["true_acceleration"].columns(n)
    acceleration = np.sqrt(sum(log[name].to_numpy() ** 2 for name in names))
    moving = np.flatnonzero(np.abs(velocity).max(axis=1) > still_m_s)
    last = int(moving[-1]) if len(moving) else 0
    computer = run.summary["motion_computer"]
    found = [(t, text) for t, _, text in computer["found"] if t >= time_s - 1e-9]
    return Outcome(
        detected_s=found[0][0] - time_s if found else None,
        description=found[0][1] if found else "",
        state=computer["state"],
        peak_acceleration_m_s2=float(acceleration[late].max()),
        before_m_s2=float(acceleration[(time >= settled_s) & ~late].max()),
        rest_s=None if last >= len(time) - 2 else max(0.0, float(time[last] - time_s)),
        lowest_m=float(position[late].min()),
        highest_m=float(position[late].max()),
        final_m=tuple(float(y) for y in position[-1]),
    )
