"""Hidden machines behind their packets, each identified from its declaration; what came of it, one JSON line a machine.

    python benchmarks/hidden_machines.py leak clean rough hexapod fault lying_rate loss --out runs/hidden
    python benchmarks/hidden_machines.py --coverage benchmarks/results/next_measurement.jsonl.gz

Each machine serves in a process of its own with numbers drawn inside its [uncertainty] and with what nobody has declared.
A case whose line is in the file is not run again; one that was interrupted goes on where it ended. --coverage: of the numbers of
right names that are called sharp (known to 10 %), how many are within 2 of their errors of the truth.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from hexsim.errors import HexsimError
from hexsim.identification import identify
from hexsim.identification.story import write_story
from hexsim.machine import load_machine
from hexsim.machine.files import changed, number_at
from hexsim.motion_computer.telemetry import unpack_telemetry
from hexsim.simulation.serve import Server
from hexsim.tracing.design.information import KNOWING

sys.path.append(str(Path(__file__).resolve().parents[1] / "tests" / "tracing"))
LEAK = {"effects.leakage_supply_to_chamber.conductance_m3_s_Pa": 2.0e-12}
SMALL = {  # what every real machine has a little of
    "effects.accelerometer_gain.relative_change": 0.004,
    "effects.position_delay.delay_s": 0.4e-3,
    "effects.entrained_air.volume_fraction": 0.003,
    "effects.null_offset.offset_V": 6e-3,
    "effects.pressure_dependent_friction.force_per_pressure_N_Pa": 1.5e-6,
    "effects.unequal_ports.tank_edge_ratio_change": 0.004,
}

HOSE = {"effects.hose_compliance.compliance_m3_Pa": 5e-14}  # as good as a dead volume, in some motions
INCLINE = {"effects.incline.angle_rad": 0.3}  # as good as a constant force: a tie
SECOND_SMALL = {
    "scale_ripple": 3e-6,
    "small_spool_lag": 150.0,
    "small_accelerometer_gain": 0.004,
    "small_air": 0.003,
    "small_null_offset": 5e-3,
    "hardening_spring": 5e4,
}
SECOND_SLOW = {"spool_lag": 20.0, **SECOND_SMALL}  # as good as a valve delay, in a multisine
SECOND_SLOW.pop("small_spool_lag")


@dataclass(frozen=True, kw_only=True)
class Hidden:
    """A machine that is not what its declaration says. spoil: what else is wrong with its server.

    second: effects of the second plant (tests/tracing/other_plant.py), which then stands in the place of hexsim's own.
    """

    declared: str = "bench"
    second: dict[str, float] | None = None
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
            if isinstance(rows, str):
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
    "hose": Hidden(changes=HOSE),
    "incline": Hidden(changes=INCLINE),
    "small_leak": Hidden(changes=SMALL | {key: 3e-13 for key in LEAK}),  # the number is wide beside what is left
    "rough_delay": Hidden(changes=SMALL | {"effects.valve_delay.delay_s": 4e-3}),  # as good as a slow spool
    "second_leak": Hidden(second={"leakage_supply_to_chamber": 1.7e-12}),
    "second_spool": Hidden(second={"leakage_supply_to_chamber": 1.7e-12, "spool_lag": 60.0}),
    "second_clean": Hidden(second={}),
    "second_rough": Hidden(second={"leakage_supply_to_chamber": 1.7e-12} | SECOND_SMALL),
    "second_slow": Hidden(second=SECOND_SLOW),
    "fault_later": Hidden(second=SECOND_SLOW, spoil=transducer_breaks(85.0)),  # in its second round
    "lying_clock": Hidden(changes=LEAK, spoil=stamps(1.01, rate_too=True)),
    "lying_rate": Hidden(changes=LEAK, spoil=stamps(1.1, rate_too=False)),
    "loss": Hidden(changes=LEAK, spoil=loses(0.01)),
    "heavy_loss": Hidden(changes=LEAK, spoil=loses(0.1)),
}


def declaration(case: Hidden) -> Path | str:
    """What the host is told: a shipped machine, or the second plant's own file."""
    if case.second is None:
        return case.declared
    from other_plant import machine_text

    folder = Path(tempfile.gettempdir()) / "hexsim-second-plant"
    folder.mkdir(exist_ok=True)
    (folder / "machine.toml").write_text(machine_text("second_plant", "bench"), encoding="utf-8")
    return folder


def serve(name: str, port: Connection) -> None:
    """The hidden machine of a case, until the process ends; tells its port first."""
    case = CASES[name]
    machine, rng = load_machine(declaration(case)), np.random.default_rng([case.seed, 31])
    drawn = {}
    if case.second is not None:
        from other_plant import true_machine
        from other_served import ServedPlant

        import hexsim.simulation.serve as serve_module

        other = true_machine("bench", case.seed, case.second)[0]
        serve_module.Plant = lambda own, **settings: ServedPlant(own, other, **settings)
    for key, half_width in (machine.uncertainty or {}).items():
        dotted, value = number_at(machine, key)
        if case.second is None:
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
    line: dict[str, Any] = {
        "case": name,
        "changes": CASES[name].second if CASES[name].second is not None else CASES[name].changes,
    }
    began = time.perf_counter()
    try:
        story = identify(
            declaration(CASES[name]),
            ("127.0.0.1", here.recv()),
            minutes,
            out / name,
            lambda doing, share: print(f"{time.perf_counter() - began:6.0f} s {doing} {share:.2f}", flush=True),
            compensate=compensate,
        )
        write_story(story)
        line |= {
            "ended": story.ended,
            "failed": story.failed,
            "bump": story.bump.to_json() if story.bump else story.no_bump,
            "machine_s": round(story.machine_s, 1),
            "rounds": [
                {
                    "verdict": one.verdict,
                    "purpose": one.purpose,
                    "open": list(one.sentences),
                    "effects": [
                        [row["name"], row["where"], row["parameters"], row.get("standard_error"), row["tied_with"]]
                        for row in one.effects
                    ],
                }
                for one in story.rounds
            ],
        }
    except HexsimError as error:
        line["refused"] = str(error)
    finally:
        process.terminate()
        process.join()
    return line | {"wall_s": round(time.perf_counter() - began)}


def coverage(journal: Path) -> list[str]:
    """Of clean and rough machines, after the first trace and after the designed run: a line each."""
    sys.path.append(str(Path(__file__).parent))
    from journal import lines_of
    from rough_machines import number_of
    from tracing_evaluation import RIGHT

    found: dict[str, list[bool]] = {}
    for row in lines_of(journal):
        for stage in ("first", "designed"):
            for name, values, errors, *_ in (row.get(stage) or {}).get("named", []):
                size = next(iter(values))
                value, error = values[size], errors.get(size) or np.inf
                if name in RIGHT.get(row["effect"], ()) and error <= KNOWING.sharp * abs(value):
                    true = number_of(row["effect"], row["effects"][row["effect"]])
                    kind = f"{'rough' if row['rough'] else 'clean'}, {stage}"
                    found.setdefault(kind, []).append(abs(value - true) < 2.0 * error)
    return [f"{kind}: {sum(own)} of {len(own)} sharp numbers within 2 errors" for kind, own in sorted(found.items())]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", nargs="*", metavar="CASE", help=", ".join(CASES))
    parser.add_argument("--coverage", type=Path, help="count in this journal, and end")
    parser.add_argument("--minutes", type=float, default=5.0)
    parser.add_argument("--compensate", action="store_true")
    parser.add_argument("--out", type=Path, default=Path("runs/hidden"))
    options = parser.parse_args()
    if options.coverage:
        print("\n".join(coverage(options.coverage)))
        return
    if unknown := set(options.cases) - set(CASES):
        parser.error(f"no such case: {', '.join(sorted(unknown))}")
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
