"""Logs of `hexsim run multisine|sweep|heave` traced against the machine that made them: nothing missing, or the effect.

    python benchmarks/tracing_round_trip.py bench                       every effect of the library at its typical size
    python benchmarks/tracing_round_trip.py micro_motion_system --effects none --seeds 100-119

One line of JSON a machine. Seeds below 100 are for tuning.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
import traceback
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from hexsim.errors import HexsimError
from hexsim.hydraulics.effects import library
from hexsim.machine import Machine, load_machine, save_machine
from hexsim.scenarios import load_scenario
from hexsim.simulation import simulate
from hexsim.tracing.fitting.parameters import named, with_settings
from hexsim.tracing.trace import trace

SCENARIOS = ("multisine", "sweep", "heave")


def with_effect(machine: Machine, name: str) -> Machine:
    """The machine with an effect of the library at its typical size, of a leg in leg 2 of a hexapod."""
    if name == "none":
        return machine
    effect = library()[name]
    candidate = named(name, "leg 2" if effect.places == "leg" and machine.is_hexapod else "all legs")
    size = effect.parameters[0]
    return with_settings(machine, {}, [(candidate, candidate.start() | {size.name: size.typical})])


def line_of(machine: Machine, name: str, seed: int, duration_s: float) -> dict[str, object]:
    """What the trace of one machine says."""
    started = time.perf_counter()
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        save_machine(machine, folder / "machine.toml")
        try:
            for k, scenario in enumerate(SCENARIOS):
                asked = load_scenario(scenario, duration_s=duration_s or None)
                run = simulate(with_effect(machine, name), asked, seed=10 * seed + k)
                run.log.write_parquet(folder / f"{scenario}.parquet")
            report = trace(folder, fit=SCENARIOS[:2], validate=SCENARIOS[2:]).report
        except HexsimError as error:
            said = {"verdict": "refused", "sentence": str(error).replace(place, "")}
        except Exception:
            said = {"verdict": "TRACEBACK", "sentence": traceback.format_exc()[-600:]}
        else:
            effects = {e["name"] + " " + e["where"]: e["parameters"] for e in report["effects"]}
            tied = sorted({name for e in report["effects"] for name in e.get("tied_with", [])})
            said = {"verdict": report["verdict"], "effects": effects, "tied": tied}
    seconds = round(time.perf_counter() - started, 1)
    return {"machine": machine.machine.name, "effect": name, "seed": seed, **said, "seconds": seconds}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("machine")
    parser.add_argument("--effects", default="")
    parser.add_argument("--seeds", default="100-100")
    parser.add_argument("--duration", type=float, default=0.0, help="of each run [s]; default the scenario's")
    asked = parser.parse_args()
    machine = load_machine(asked.machine)
    able = [e.name for e in library().values() if machine.machine.kind in e.kinds and e.parameters]
    first, last = map(int, asked.seeds.split("-"))
    for name in asked.effects.split(",") if asked.effects else ["none", *able]:
        for seed in range(first, last + 1):
            print(json.dumps(line_of(machine, name, seed, asked.duration)), flush=True)


if __name__ == "__main__":
    main()
