"""Hidden machines behind their packets, each identified from its declaration; what came of it, one JSON line a machine.

    python benchmarks/hidden_machines.py leak clean rough hexapod fault lying_rate loss --out runs/hidden

Each machine serves in a process of its own with numbers drawn inside its [uncertainty] and with what nobody has declared.
A case whose line is in the file is not run again; one that was interrupted goes on where it ended.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from hexsim.errors import HexsimError
from hexsim.identify import identify
from hexsim.identify.story import write_story
from hexsim.machine import load_machine
from hexsim.machine.files import changed, number_at
from hexsim.motion_computer.telemetry import unpack_telemetry
from hexsim.simulation.serve import Server

LEAK = {"effects.leakage_supply_to_chamber.conductance_m3_s_Pa": 2.0e-12}
SMALL = {  # what every real machine has a little of
    "effects.accelerometer_gain.relative_change": 0.004,
    "effects.position_delay.delay_s": 0.4e-3,
    "effects.entrained_air.volume_fraction": 0.003,
    "effects.null_offset.offset_V": 6e-3,
    "effects.pressure_dependent_friction.force_per_pressure_N_Pa": 1.5e-6,
    "effects.unequal_ports.tank_edge_ratio_change": 0.004,
}


@dataclass(frozen=True, kw_only=True)
class Hidden:
    """A machine that is not what its declaration says. spoil: what else is wrong with its server."""

    declared: str = "bench"
    changes: dict[str, Any] = field(default_factory=dict)
    spoil: Callable[[Server], None] = lambda server: None
    seed: int = 1


def loses(share: float) -> Callable[[Server], None]:
    """Packets of the machine are lost at random."""

    def spoil(server: Server) -> None:
        send, rng = server.link.send_packet, np.random.default_rng(5)
        server.link.send_packet = lambda data: send(data) if rng.random() > share else None

    return spoil


def stamps(scale: float, rate_too: bool) -> Callable[[Server], None]:
    """Telemetry whose clock runs `scale` times as fast as it should; with it the rate it claims, or not."""

    def spoil(server: Server) -> None:
        send = server.link.send_packet

        def lie(data: bytes) -> None:
            rows = unpack_telemetry(data)
            if rows is None:
                return send(data)
            rate = rows.rate_Hz / scale if rate_too else rows.rate_Hz
            send(replace(rows, time_s=rows.time_s * scale, rate_Hz=rate).pack())

        server.link.send_packet = lie

    return spoil


def transducer_breaks(at_s: float) -> Callable[[Server], None]:
    """The position is not a number from `at_s` on: the motion computer goes to fault."""

    def spoil(server: Server) -> None:
        read = server.sensors.read

        def broken(tick: int) -> Any:
            position, *rest = read(tick)
            return (np.full_like(position, np.nan) if server.time_s > at_s else position, *rest)

        server.sensors.read = broken

    return spoil


CASES = {
    "leak": Hidden(changes=LEAK),
    "clean": Hidden(),
    "rough": Hidden(changes=LEAK | SMALL),
    "hexapod": Hidden(
        declared="micro_motion_system",
        changes={"effects.leakage_supply_to_chamber": {"conductance_m3_s_Pa": 2.0e-12, "where": "leg 3"}},
    ),
    "fault": Hidden(changes=LEAK, spoil=transducer_breaks(50.0)),
    "fault_later": Hidden(changes=LEAK | SMALL, spoil=transducer_breaks(100.0)),
    "lying_clock": Hidden(changes=LEAK, spoil=stamps(1.01, rate_too=True)),
    "lying_rate": Hidden(changes=LEAK, spoil=stamps(1.1, rate_too=False)),
    "loss": Hidden(changes=LEAK, spoil=loses(0.01)),
    "heavy_loss": Hidden(changes=LEAK, spoil=loses(0.1)),
}


def serve(name: str, port: Connection) -> None:
    """The hidden machine of a case, until the process ends; tells its port first."""
    case = CASES[name]
    machine, rng = load_machine(case.declared), np.random.default_rng([case.seed, 31])
    drawn = {}
    for key, half_width in (machine.uncertainty or {}).items():
        dotted, value = number_at(machine, key)
        drawn[dotted] = value * (1.0 + half_width * rng.uniform(-1.0, 1.0))
    with Server(changed(machine, drawn | case.changes), port=0, telemetry=True, lockstep=True) as server:
        case.spoil(server)
        port.send(server.address[1])
        server.run()


def run_one(name: str, minutes: float, out: Path, compensate: bool) -> dict[str, Any]:
    """Serve it, identify it, and say what came of it."""
    here, there = multiprocessing.Pipe()
    process = multiprocessing.get_context("spawn").Process(target=serve, args=(name, there), daemon=True)
    process.start()
    line: dict[str, Any] = {"case": name, "changes": CASES[name].changes}
    began = time.perf_counter()
    try:
        story = identify(
            CASES[name].declared, ("127.0.0.1", here.recv()), minutes, out / name,
            lambda doing, share: print(f"{time.perf_counter() - began:6.0f} s {doing} {share:.2f}", flush=True),
            compensate=compensate,
        )  # fmt: skip
        write_story(story)
        line |= {
            "ended": story.ended, "failed": story.failed,
            "bump": story.bump.to_json() if story.bump else story.no_bump, "machine_s": round(story.machine_s, 1),
            "rounds": [
                {
                    "verdict": one.verdict, "purpose": one.purpose, "open": list(one.sentences),
                    "effects": [
                        [row["name"], row["where"], row["parameters"], row.get("standard_error"), row["tied_with"]]
                        for row in one.effects
                    ],
                }
                for one in story.rounds
            ],
        }  # fmt: skip
    except HexsimError as error:
        line["refused"] = str(error)
    finally:
        process.terminate()
        process.join()
    return line | {"wall_s": round(time.perf_counter() - began)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", nargs="+", choices=list(CASES))
    parser.add_argument("--minutes", type=float, default=5.0)
    parser.add_argument("--compensate", action="store_true")
    parser.add_argument("--out", type=Path, default=Path("runs/hidden"))
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    results = options.out / "hidden.jsonl"
    known = [json.loads(text) for text in results.read_text().splitlines()] if results.is_file() else []
    for name in options.cases:
        if any(line["case"] == name for line in known):
            continue
        line = run_one(name, options.minutes, options.out, options.compensate)
        with results.open("a") as file:
            file.write(json.dumps(line) + "\n")
        print(json.dumps(line, indent=1), flush=True)


if __name__ == "__main__":
    main()
