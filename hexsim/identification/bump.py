"""The end of the story: the machine's own reversal bump in heave, before and after compensation.

The compensator learns on the identified twin, in simulation. The machine then makes the same sine twice, with plain
control and with the compensator that starts with what the twin has taught it.

    peak of a reversal    largest |acceleration - mean - fundamental| within 0.2 s of it, in 50 Hz
    the bump              the largest peak from the second reversal at full size on

Judged on the machine's own accelerometer, so that its noise is in both.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import polars as pl
from numpy.typing import NDArray

from compensation.compensator import Parameters
from hexsim.declaration import Machine
from hexsim.errors import HexsimError
from hexsim.files.log_files import write_log
from hexsim.identification.host import Host
from hexsim.motion_computer.host_limiter import setpoints_of
from hexsim.scenarios.scenario import scenario_from_dict
from hexsim.smoothness.harmonic import HarmonicDeviation, harmonic_deviation
from hexsim.studies.tune_start import FREQUENCY_Hz, half_hertz_sine, simulate_twin

Array = NDArray[np.float64]
ALGORITHM = "adaptive"


class Motion(NamedTuple):
    """The motion in which the bump is measured."""

    fade_s: float = 2.0  # to full size: short, so that the first reversal is one that is compensated
    periods: int = 5  # at full size
    unchanged: float = 0.9  # of the bump: what is left where plain control has acted


MOTION = Motion()

LOGS = ("heave_plain", "heave_compensated")


@dataclass(frozen=True, kw_only=True, eq=False)
class Bump:
    """The same sine without and with compensation."""

    plain: HarmonicDeviation
    compensated: HarmonicDeviation

    @property
    def before(self) -> float:
        """[m/s2]"""
        return worst(self.plain)

    @property
    def after(self) -> float:
        """[m/s2]"""
        return worst(self.compensated)

    @property
    def share(self) -> str:
        """What is left of it, in words."""
        if self.after > MOTION.unchanged * self.before:
            return "no smaller: the compensator did not act"
        return (
            f"1/{self.before / self.after:.0f}" if self.before > 2.5 * self.after else f"{self.after / self.before:.0%}"
        )

    @property
    def left(self) -> str:
        """The same in a sentence's end."""
        return f"{self.share} of it is left" if self.after <= MOTION.unchanged * self.before else self.share

    def to_json(self) -> dict[str, Any]:
        return {
            "plain_m_s2": self.before,
            "compensated_m_s2": self.after,
            "peaks_plain_m_s2": [peak.peak for peak in self.plain.peaks()],
            "peaks_compensated_m_s2": [peak.peak for peak in self.compensated.peaks()],
        }


def worst(deviation: HarmonicDeviation) -> float:
    """Largest peak from the second reversal on [m/s2]."""
    return max((peak.peak for peak in deviation.peaks()[1:]), default=float("nan"))


def heave(machine: Machine, at_full_size_s: float) -> dict[str, Any]:
    """The half-hertz sine as a scenario's tables: along z of a platform, on the leg of a bench."""
    axis = "z" if machine.is_hexapod else "leg_1"
    return {
        "name": "heave",
        "mode": "dof" if machine.is_hexapod else "actuator",
        "duration_s": MOTION.fade_s + at_full_size_s,
        "fade_s": MOTION.fade_s,
        "fade": "smooth",
        "axes": {axis: half_hertz_sine(machine)},
    }


def measured_heave(machine: Machine) -> dict[str, Any]:
    """The heave that the machine itself is driven in."""
    return heave(machine, MOTION.periods / FREQUENCY_Hz + MOTION.fade_s)


def start_parameters(
    twin: Machine,
    show: Callable[[float], None] = lambda share: None,
    *,
    bench_s: float = 60.0,  # of a bench's twin
    platform_s: float = 30.0,  # of a platform's, which costs more
) -> list[Parameters]:
    """What the compensator learns of each leg of a simulated machine in heave."""
    duration_s = platform_s if twin.is_hexapod else bench_s
    return simulate_twin(twin, scenario_from_dict(heave(twin, duration_s)), ALGORITHM, show).compensator_parameters


def measure_bump(
    host: Host, machine: Machine, learned: list[Parameters], logs: Path, tell: Callable[[str, float], None]
) -> None:
    """Drive the sine with plain control and with the compensator, into `logs`; leaves plain control behind.

    Raises HexsimError where the machine takes no compensator.
    """
    tables = measured_heave(machine)
    for name, asked in zip(LOGS, ("none", ALGORITHM), strict=True):
        host.compensate(asked, learned, machine.n_legs)
        host.rest()  # its model of plain control begins at the setpoint: where the machine stands shows in a second
        doing = "the bump without compensation" if asked == "none" else "the bump with compensation"
        write_log(
            host.drive(setpoints_of(machine, tables), lambda share, doing=doing: tell(doing, share)),
            logs / f"{name}.parquet",
        )
    host.compensate("none", [], machine.n_legs)


def bump_of(machine: Machine, logs: Path) -> Bump:
    """The figures of the two logs."""
    plain, compensated = (taken_apart(machine, pl.read_parquet(logs / f"{name}.parquet")) for name in LOGS)
    return Bump(plain=plain, compensated=compensated)


def taken_apart(machine: Machine, log: pl.DataFrame) -> HarmonicDeviation:
    """The sine at full size; samples that were lost on the way are filled linearly."""
    time, name = log["time_s"].to_numpy(), "acceleration_z_m_s2" if machine.is_hexapod else "acceleration_m_s2"
    if name not in log.columns:
        raise HexsimError(f"the machine sends no {name}: without an accelerometer nobody can tell its bump")
    rate = 1.0 / float(np.median(np.diff(time)))
    even = np.arange(0.0, MOTION.fade_s + MOTION.periods / FREQUENCY_Hz, 1.0 / rate)
    return harmonic_deviation(even, np.interp(even, time, log[name].to_numpy()), FREQUENCY_Hz, start_s=MOTION.fade_s)
