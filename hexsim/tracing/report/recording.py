"""Measured, declared and fitted on one time line: the held-out logs of a trace as Rerun recordings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from hexsim.errors import HexsimError
from hexsim.machine import Machine
from hexsim.machine.files import changed
from hexsim.readers import log_files, read_log
from hexsim.recording.rerun_recording import entity_name, write_recording
from hexsim.recording.signals import Signals
from hexsim.scenarios import replay_scenario
from hexsim.signals.log import Log
from hexsim.signals.table import STANDARD, sensors
from hexsim.simulation import simulate

QUIET = {f"sensors.{sensors()[stem].noise}": 0.0 for stem in STANDARD}


def write_trace_recordings(
    folder: Path, names: Sequence[str], declared: Machine, fitted: Machine, out: Path, text: str = ""
) -> list[Path]:
    """One recording a held-out log: `out`/<log>.rrd. `folder` holds the machine's logs, `text` says what was found."""

    written = []
    for name in names:
        log = read_log(log_files(folder, name))
        written.append(out / f"{entity_name(log.name)}.rrd")
        write_recording(written[-1], replayed(log, {"declared": declared, "fitted": fitted}), {"measured": text})
    return written


def replayed(measured: Log, machines: dict[str, Machine]) -> dict[str, Signals]:
    """The measured log, and what each machine does on its setpoints; `deviation` is from the measured acceleration.

    The machines' accelerations are what their sensors would read without noise: samples at the control's ticks, as the
    measured ones are; a bench is stepped with RK4, whose samples there are right. A log without setpoints stands alone,
    and so does one that a machine cannot follow.
    """
    time = measured.time
    measured = replace(measured, time=time - time[0])
    first = next(iter(machines.values()))
    seen = Signals(log=measured, machine=first, label="measured")
    itself = {axis: values for axis in seen.axes if (values := seen.acceleration(axis)) is not None}
    shown = {"measured": Signals(log=measured, machine=first, label="measured", wanted=itself)}
    if measured.setpoint is None:
        return shown
    asked = np.ascontiguousarray(measured.setpoint.T)
    for label, machine in machines.items():
        scenario = replay_scenario(label, time, asked, machine.cylinder.stroke_m)
        try:
            run = simulate(changed(machine, QUIET), scenario, fast=machine.is_hexapod)
        except HexsimError:
            continue
        log = Log.of_table(label, run.log, measured.kind)
        signals = Signals(log=log, machine=machine, label=label, measured=True)
        wanted = {axis: np.interp(signals.time_s, seen.time_s, values) for axis, values in itself.items()}
        shown[label] = replace(signals, wanted=wanted)
    return shown
