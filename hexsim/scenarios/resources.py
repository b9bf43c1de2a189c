"""Memory and disk that a run needs, estimated before it starts.

Measured on runs of a minute at 1 kHz: 0.65 kB of memory a tick for a bench, 3.5 kB for a hexapod on tendons, 1 kB more
for figures and recording; 0.3 and 1.6 kB of disk a row of the log. The estimates below are up to twice that.
"""

from __future__ import annotations

import math
import shutil
from pathlib import Path

import psutil

from hexsim.declaration import Machine
from hexsim.errors import HexsimError
from hexsim.smoothness.band import BANDWIDTH_Hz

try:
    import resource
except ImportError:  # Windows: a process has no limit of its own
    resource = None

CONTROL_GROUP = Path("/sys/fs/cgroup")


def tick_rate_Hz(machine: Machine) -> float:
    """Rate of the ticks of a run: of the log or of the controller, whichever is faster, and a multiple of that where it is
    too slow for the figures: a mean over one takes 0.4 % of an amplitude at the end of the band."""
    rate = max(machine.sensors.log_rate_Hz, machine.controller.rate_Hz)
    return rate * math.ceil(20 * BANDWIDTH_Hz / rate)


def check_resources(
    machine: Machine,
    duration_s: float,
    folder: Path | None = None,
    *,
    values_a_tick: int = 100,  # of 8 bytes, a leg: states, noise and setpoints
    copies: int = 3,  # of the log while it is made and plotted
    columns_a_leg: int = 20,  # of the log
) -> None:
    """Raise HexsimError when the log would not fit into memory, or into the disk of `folder`, or has no two rows."""
    rate = tick_rate_Hz(machine)
    rows, legs = duration_s * machine.sensors.log_rate_Hz, machine.n_legs
    if rows < 2:
        raise HexsimError(
            f"duration {duration_s:g} s is shorter than two samples of the log at {machine.sensors.log_rate_Hz:g} Hz: "
            "make it longer, or raise sensors.log_rate_Hz"
        )
    memory = 8.0 * legs * (values_a_tick * duration_s * rate + copies * columns_a_leg * rows)
    disk = 3e6 + 16.0 * legs * columns_a_leg * rows  # figures and the report, whatever the length
    _refuse_beyond(available_memory(), memory, duration_s, "memory")
    if folder is not None:
        _refuse_beyond(shutil.disk_usage(folder).free, disk, duration_s, f"disk for {folder}")


def _refuse_beyond(there: float, needed: float, duration_s: float, what: str) -> None:
    if needed > there:
        raise HexsimError(
            f"a run of {duration_s:g} s needs about {needed / 1e9:.2g} GB of {what}, and {there / 1e9:.2g} GB are free: "
            "make it shorter, or lower sensors.log_rate_Hz and controller.rate_Hz"
        )


def available_memory() -> float:
    """Bytes that this process may still take: of the computer, of its container, and of its own limit."""
    found = [float(psutil.virtual_memory().available)]
    limit, used = (CONTROL_GROUP / f"memory.{name}" for name in ("max", "current"))
    if limit.is_file() and used.is_file() and (text := limit.read_text().strip()) != "max":
        found.append(float(text) - float(used.read_text()))
    if resource is not None:
        most = resource.getrlimit(resource.RLIMIT_AS)[0]
        if most != resource.RLIM_INFINITY:
            found.append(float(most - psutil.Process().memory_info().vms))
    return min(found)
