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

from hexsim.identification import Story, identify
from hexsim.identification.story import write_story
from hexsim.machine import load_machine
from hexsim.machine.files import changed
from hexsim.simulation.serve import Server

LEAK_m3_s_Pa = 2.0e-12


def hidden_machine(name: str, port: Connection) -> None:
    """Serve the machine with its leak until the process ends; tells its port first."""
    declared = load_machine(name)
    leak = {"conductance_m3_s_Pa": LEAK_m3_s_Pa, "where": "leg 3" if declared.is_hexapod else "leg 1"}
    hidden = changed(declared, {"effects.leakage_supply_to_chamber": leak})
    with Server(hidden, port=0, telemetry=True, lockstep=True) as server:
        port.send(server.address[1])
        server.run()


def close_the_loop(machine: str, minutes: float, out: Path) -> Story:
    """Start the hidden machine, identify it, end it."""
    here, there = multiprocessing.Pipe()
    process = multiprocessing.get_context("spawn").Process(target=hidden_machine, args=(machine, there), daemon=True)
    process.start()
    try:
        return identify(machine, ("127.0.0.1", here.recv()), minutes, out, lambda doing, share: None, compensate=True)
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
    story = close_the_loop(arguments.machine, arguments.minutes, arguments.out)
    for one in story.rounds:
        print(f"round {one.number}: {one.verdict}; {'; '.join(one.sentences) or 'nothing left open'}")
    print(f"ended: {story.ended}")
    if story.bump:
        print(f"bump: {story.bump.before:.3f} m/s2 as it was, {story.bump.after:.3f} m/s2 compensated")
    print(f"story: {write_story(story)}")


if __name__ == "__main__":
    main()
