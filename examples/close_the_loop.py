"""A hidden machine is identified behind its packets: it leaks, and nobody has declared that.

    python examples/close_the_loop.py --minutes 5 --out runs/close-the-loop

The machine runs in a process of its own and shows nothing but telemetry. `identify` finds what its declaration lacks,
and shows the machine's bump before and after a compensator that starts with what was found.
"""

from __future__ import annotations

import argparse
import multiprocessing
from multiprocessing.connection import Connection
from pathlib import Path

import hexsim as hx
from hexsim.simulation.serve import Server

LEAK_m3_s_Pa = 2.0e-12


def hidden_machine(name: str, port: Connection) -> None:
    """Serve the machine with its leak until the process ends; tells its port first."""
    declared = hx.load_machine(name)
    leak = {"conductance_m3_s_Pa": LEAK_m3_s_Pa, "where": "leg 3" if declared.is_hexapod else "leg 1"}
    hidden = declared.with_({"effects.leakage_supply_to_chamber": leak})
    with Server(hidden, port=0, telemetry=True, lockstep=True) as server:
        port.send(server.address[1])
        server.run()


def close_the_loop(machine: str, minutes: float, out: Path) -> hx.Identification:
    """Start the hidden machine, identify it, end it."""
    here, there = multiprocessing.Pipe()
    process = multiprocessing.get_context("spawn").Process(target=hidden_machine, args=(machine, there), daemon=True)
    process.start()
    try:
        return hx.identify(machine, out, f"127.0.0.1:{here.recv()}", minutes=minutes, compensate=True)
    finally:
        process.terminate()
        process.join()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--machine", default="bench", help="as declared, without the leak; micro_motion_system: leg 3 leaks"
    )
    parser.add_argument("--minutes", type=float, default=5.0, help="of machine time")
    parser.add_argument("--out", type=Path, default=Path("runs/close-the-loop"))
    arguments = parser.parse_args()
    found = close_the_loop(arguments.machine, arguments.minutes, arguments.out)
    for number, verdict, _, left_open in found.rounds.iter_rows():
        print(f"round {number}: {verdict}; {left_open or 'nothing left open'}")
    print(f"ended: {found.ended}")
    bump = found.story["bump"]
    if isinstance(bump, dict):
        print(f"bump: {bump['plain_m_s2']:.3f} m/s2 as it was, {bump['compensated_m_s2']:.3f} m/s2 compensated")
    elif bump:
        print(f"the bump was not compared: {bump}")
    print(f"story: {found.to_folder() / 'report.html'}")


if __name__ == "__main__":
    main()
