"""What an operator files: the rows of every test with their sources, raw traces, and a manifest with hashes.

    pack.json, pack.html      rows by test; OMCT's points
    traces/*.csv.gz           the record of every motion that a row comes from, 1 kHz
    manifest.json             SHA-256 and size of every file of the folder, machine file and versions

A simulation qualifies no device: the pack shows what a device's own would hold, and what the rule has no number for.
"""

from __future__ import annotations

import gzip
import hashlib
import json
import platform
import re
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import polars as pl
import tomli_w

from compensation import Compensator
from hexsim import __version__
from hexsim.cueing.washout import Washout
from hexsim.declaration import Machine
from hexsim.errors import HexsimError
from hexsim.files.atomic import write_text, written_whole
from hexsim.machine.files import machine_tables
from hexsim.qualification import part60
from hexsim.qualification.battery import Findings
from hexsim.qualification.omct import SOURCE, Point, machine_response, omct
from hexsim.qualification.rig import MachineRig, Motion, Record
from hexsim.qualification.rows import NO_LIMIT, ROTATIONS, Row
from hexsim.recording.page import Column, Report, Section, bold, lead, remark, table
from hexsim.scenarios import Scenario

OWN = "[S] 14 CFR Part 60, app. A, table A2A, {}: as specified by the applicant; the limit shown is the applicant's own"
OWNED = {"describing function": "3.a", "leg balance": "3.b", "turn-around": "3.c"}
Progress = Callable[[float], None]


def pack_rows(found: Findings) -> list[Row]:
    """The battery's rows as they are filed: what the rule leaves to the applicant says so, what has no number too."""
    rows = []
    for row in found.rows:
        if row.test == "repeatability":
            continue  # tested under the rule's own conditions in the pack
        if row.test in OWNED:
            row = Row(**{**asdict(row), "source": OWN.format(OWNED[row.test])})
        elif row.source == NO_LIMIT:
            row = Row(**{**asdict(row), "source": part60.NO_NUMBER})
        rows.append(row)
    return rows


def recorder(folder: Path) -> Record:
    """Writes each motion of the battery into folder/traces as it is played, named as its scenario: what was asked of the driven
    axis and where it was, the acceleration of all axes; of a half-hertz motion the legs too."""

    def record(scenario: Scenario, motion: Motion) -> None:
        [axis] = scenario.signals
        m = "rad" if axis in ROTATIONS else "m"
        columns = {
            "time_s": motion.time_s,
            f"commanded_{axis}_{m}": motion.commanded[axis],
            f"platform_{axis}_{m}": motion.response[axis],
        }
        for name, values in motion.acceleration.items():
            columns[f"acceleration_{name}_{'rad' if name in ROTATIONS else 'm'}_s2"] = values
        if "half-hertz" in scenario.name:
            for leg, (asked, found) in enumerate(zip(motion.leg_setpoints.T, motion.leg_positions.T, strict=True), 1):
                columns |= {f"setpoint_{leg}_m": asked, f"position_{leg}_m": found}
        _write_trace(folder, part60.Trace(name=re.sub(r"[^\w.-]+", "_", scenario.name), columns=columns))

    return record


def _write_trace(folder: Path, trace: part60.Trace) -> None:
    """The same bytes for the same numbers: gzip's own time is left out."""
    frame = pl.DataFrame({name: np.asarray(values, dtype=float) for name, values in trace.columns.items()})
    path = folder / "traces" / f"{trace.name}.csv.gz"
    path.parent.mkdir(parents=True, exist_ok=True)
    with written_whole(path) as begun:
        begun.write_bytes(gzip.compress(frame.write_csv(float_precision=9).encode(), mtime=0))


def write_pack(
    machine: Machine,
    found: Findings,
    out: str | Path,
    *,
    compensator: str | Compensator = "none",
    flight: Washout | None = None,
    ground: Washout | None = None,
    pilot_m: tuple[float, float, float] = part60.TRIAL.pilot_m,
    progress: Progress = lambda fraction: None,
) -> dict[str, Any]:
    """Run the tests beyond the battery's and write the pack into the folder `out`; returns what pack.json holds.

    found: of the battery on the same machine. flight, ground: washouts of the two modes; ground None: as in flight, and one
    mode is tested. pilot_m: the pilot's reference point from the vehicle's centre of gravity, forward, left, up.
    """
    if not machine.mechanics.has_platform:
        raise HexsimError(f"machine {machine.name} has no platform: a pack is filed for one that carries people")
    rig, flight = MachineRig(machine, compensator), flight or Washout()
    modes = {"flight": flight} if ground is None or ground == flight else {"flight": flight, "ground": ground}
    rows, traces = pack_rows(found), []
    for n, (mode, washout) in enumerate(modes.items()):
        start = 0.4 * n / len(modes)
        more, records = part60.repeatability(
            rig, washout, mode, pilot_m=pilot_m, progress=lambda f, start=start: progress(start + 0.4 * f / len(modes))
        )
        rows, traces = rows + more, traces + records
    for made in (part60.onset(machine, compensator), part60.noise(rig)):
        rows, traces = rows + made[0], traces + made[1]
        progress(0.5)
    rows += part60.envelope(machine)
    response = machine_response(found.curves["describing_function"])
    points = omct(flight, machine.controller.rate_Hz, response, progress=lambda f: progress(0.5 + 0.5 * f))
    result = {
        "machine": machine.name,
        "compensator": compensator if isinstance(compensator, str) else compensator.name,
        "modes": list(modes),
        "one_mode": len(modes) == 1,
        "pilot_m": list(pilot_m),
        "rows": [asdict(row) | {"passed": row.passed} for row in rows],
        "omct": {"source": SOURCE, "points": [asdict(point) for point in points]},
    }
    _write(Path(out), result, rows, points, traces, machine)
    return result


def _write(
    folder: Path,
    result: dict[str, Any],
    rows: Sequence[Row],
    points: Sequence[Point],
    traces: Sequence[part60.Trace],
    machine: Machine,
) -> None:
    for trace in traces:
        _write_trace(folder, trace)
    write_text(folder / "machine.toml", tomli_w.dumps(machine_tables(machine)))
    write_text(folder / "pack.json", json.dumps(result, indent=1, allow_nan=False))
    write_text(folder / "pack.html", page(result, rows, points))
    write_manifest(folder)


def write_manifest(folder: Path) -> None:
    """manifest.json: every other file of the folder with its size and SHA-256, and what made them; hidden ones are not the
    pack's (a folder in the making has a lock)."""
    files = {
        path.relative_to(folder).as_posix(): {
            "bytes": path.stat().st_size,
            "sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
        }
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name != "manifest.json" and not path.name.startswith(".")
    }
    versions = {"hexsim": __version__, "mujoco": mujoco.__version__, "python": platform.python_version()}
    write_text(folder / "manifest.json", json.dumps({"versions": versions, "files": files}, indent=1))


def page(result: dict[str, Any], rows: Sequence[Row], points: Sequence[Point]) -> str:
    """pack.html: what is outside, rows, OMCT below."""

    def shown(value: float | None, unit: str, missing: str) -> str:
        return missing if value is None else f"{value:.4g}{'' if unit in ('', '1') else f' {unit}'}"

    verdict = {True: "within", False: bold("outside"), None: "reported"}
    tests = [
        (
            r.test,
            r.axis,
            r.figure,
            shown(r.value, r.unit, "not reached"),
            shown(r.limit, r.unit, ""),
            verdict[r.passed],
            r.source,
        )
        for r in rows
    ]
    text = [Column(head, "wide") for head in ("axis", "figure", "value", "limit", "verdict", "source")]
    cues = [(p.test, f"{p.frequency_rad_s:.4g}", f"{p.modulus:.4g}", f"{p.phase_deg:.4g}") for p in points]
    judged, outside = [r for r in rows if r.passed is not None], [r for r in rows if r.passed is False]
    found = f"{len(judged) - len(outside)} of {len(judged)} figures with a limit are within it."
    if outside:
        found += f" Outside: {'; '.join(f'{r.test}, {r.axis}, limit {r.limit:g} {r.unit}' for r in outside)}."
    modes = "one mode: ground and flight have the same washout" if result["one_mode"] else "ground and flight"
    about = (
        f"A simulation; it qualifies no device. Motion modes tested: {modes}. Pilot's reference point {result['pilot_m']} m "
        "forward, left and up of the vehicle's centre of gravity. Records in traces/, hashes in manifest.json."
    )
    cueing = table(["test", "frequency [rad/s]", "modulus", "phase [deg]"], cues, cues)
    return Report(
        f"Qualification pack of {result['machine']}, compensator {result['compensator']}",
        [
            Section("Tests", [table(["test", *text], tests, tests)]),
            Section("Objective motion cueing test", [remark(SOURCE), cueing]),
        ],
        about=about,
        top=[lead(found)],
    ).html()
