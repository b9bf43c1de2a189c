"""The table of docs/faults.md: every fault on the 600 kg machine in heave, what the motion computer saw and did.

    python benchmarks/fault_table.py               writes docs/results/faults.json and the table of docs/faults.md
    python benchmarks/fault_table.py --manifold    faults_manifold.json and its table: with a safety manifold

Heave of 0.05 m at 0.5 Hz; the fault comes at t = 3.3 s, in the middle of a downward stroke. Full legs (--fast:
tendon model). Sensor noise of seed 0.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hexsim import HexsimError
from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.scenarios import load_scenario
from hexsim.signals.table import table
from hexsim.simulation import Run, simulate

RESULTS = Path(__file__).parents[1] / "docs" / "results"
TIME_s = 3.3
BEGIN, END = "<!-- written by benchmarks/fault_table.py: {} -->", "<!-- end -->"
CASES: tuple[tuple[str, dict[str, Any]], ...] = (
    ("valve stuck fully open, up", {"kind": "valve_stuck", "leg": 1, "at": "open"}),
    ("valve stuck fully open, down", {"kind": "valve_stuck", "leg": 1, "at": -10.0}),
    ("valve stuck at +2 V", {"kind": "valve_stuck", "leg": 1, "at": 2.0}),
    ("valve stuck where it was", {"kind": "valve_stuck", "leg": 1, "at": "present"}),
    ("valve stuck shut", {"kind": "valve_stuck", "leg": 1, "at": "shut"}),
    ("spool lag, 1 Hz", {"kind": "spool_lag", "leg": 1, "frequency_Hz": 1.0}),
    ("position sensor lost", {"kind": "position_sensor", "leg": 1, "how": "nan"}),
    ("position sensor frozen", {"kind": "position_sensor", "leg": 1, "how": "frozen"}),
    ("position sensor jumps by 20 mm", {"kind": "position_sensor", "leg": 1, "how": "jump"}),
    ("one leg blind", {"kind": "leg_blind", "leg": 1}),
    ("pressure loss to 20 bar", {"kind": "pressure_loss"}),
    ("pump trip", {"kind": "pump_trip"}),
    ("hose burst, 12 l/min at 40 bar", {"kind": "hose_burst", "leg": 1}),
    ("power loss, cabinet on battery", {"kind": "power_loss", "buffered": True}),
    ("power loss, cabinet too", {"kind": "power_loss", "buffered": False}),
    ("payload shift, 150 kg by 0.4 m", {"kind": "payload_shift"}),
    ("host silent", {"kind": "host_silence"}),
)


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


def run_case(fault: dict[str, Any], fast: bool, machine: Any) -> Outcome:
    scenario = dataclasses.replace(load_scenario("heave", duration_s=12.0), faults=({**fault, "time_s": TIME_s},))
    return outcome(simulate(machine, scenario, fast=fast), TIME_s)


def line(name: str, found: Outcome, stroke_m: float, cushion_m: float) -> str:
    """One line of the table."""
    detected = "not detected" if found.detected_s is None else f"{1e3 * found.detected_s:.0f} ms"
    down = [y < cushion_m for y in found.final_m]
    standing = [str(i + 1) for i, is_down in enumerate(down) if not is_down]
    where = "all" if all(down) else ("none" if not any(down) else f"all but leg {', '.join(standing)}")
    error = found.description.partition(":")[0]
    rest = "moving" if found.rest_s is None else f"{found.rest_s:.1f} s"
    depth = max(cushion_m - found.lowest_m, found.highest_m - (stroke_m - cushion_m), 0.0)
    return (
        f"| {name} | {detected} | {error} | {where} | {rest} | {found.peak_acceleration_m_s2:.3g} | {1e3 * depth:.1f} |"
    )


def into_document(table: str, name: str) -> None:
    """Put the table between its marks in docs/faults.md, where that has them."""
    document, begin = RESULTS.parent / "faults.md", BEGIN.format(name)
    before, mark, rest = document.read_text(encoding="utf-8").partition(begin)
    if mark:
        _, _, after = rest.partition(END)
        document.write_text(f"{before}{begin}\n{table}{END}{after}", encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--fast", action="store_true", help="tendon model")
    parser.add_argument("--machine", default="micro_motion_system")
    parser.add_argument("--manifold", action="store_true", help="with a safety manifold of default sizes")
    parser.add_argument("--name", help="of the files in docs/results")
    arguments = parser.parse_args()
    file_name = arguments.name or ("faults_manifold" if arguments.manifold else "faults")
    machine = changed(load_machine(arguments.machine), {"manifold": {}} if arguments.manifold else {})
    cylinder = machine.cylinder
    rows, data = [], {}
    for name, fault in CASES:
        found = run_case(fault, arguments.fast, machine)
        data[name] = {"fault": fault, **dataclasses.asdict(found)}
        rows.append(line(name, found, cylinder.stroke_m, cylinder.cushion_length_m))
        print(rows[-1], flush=True)
    head = (
        "| fault | detected after | error | legs down | at rest after | peak [m/s²] | "
        f"into the cushion of {1e3 * cylinder.cushion_length_m:g} mm [mm] |\n|---|---|---|---|---|---|---|\n"
    )
    RESULTS.mkdir(parents=True, exist_ok=True)
    (RESULTS / f"{file_name}.json").write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")
    table = head + "\n".join(rows) + "\n"
    into_document(table, file_name)


if __name__ == "__main__":
    main()
