"""The end of the story: the machine's own reversal bump in heave, before and after compensation.

The compensator learns on the identified twin, in simulation. The machine then makes the same sine twice, with plain
control and with the compensator that starts with what the twin has taught it.

    peak of a reversal    largest |acceleration - mean - fundamental| within 0.2 s of it, in 50 Hz
    the bump              the largest peak from the second reversal at full size on

Judged on the machine's own accelerometer, so that its noise is in both.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from compensation.adaptive.layout import SPOOLS
from compensation.compensator import Parameters
from hexsim.declaration import Machine
from hexsim.errors import HexsimError
from hexsim.files.json_files import write_json
from hexsim.files.log_files import write_log
from hexsim.hydraulics.parameters import P
from hexsim.hydraulics.resolve import resolve
from hexsim.identification.host import Host
from hexsim.motion_computer.host_limiter import setpoints_of
from hexsim.scenarios.scenario import scenario_from_dict
from hexsim.simulation import Run
from hexsim.smoothness.harmonic import HarmonicDeviation, harmonic_deviation
from hexsim.studies.tune_start import FILE, FREQUENCY_Hz, half_hertz_sine, simulate_twin

Array = NDArray[np.float64]
ALGORITHM = "adaptive"
FADE_s = 2.0  # to full size: short, so that the first reversal is one that is compensated
PERIODS = 5  # at full size
LEARNING_s = 120.0  # of a bench's twin: of a late position 30 s tell 0.16 of 0.4 ms, these 0.25
LEARNING_PLATFORM_s = 30.0  # of a platform's, which costs more
STEADY_V = 1e-3  # by which a null may drift meanwhile
NO_DELAY = {"sums": [0.0] * SPOOLS, "reversals": 0.0, "late_s": 0.0}  # start parameters that tell nothing of it
UNCHANGED = 0.9  # of the bump: what is left where plain control has acted
KEYS = ("edge_rounding_m", "spool_travel_max_m", "voltage_max_V")
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
        if self.after > UNCHANGED * self.before:
            return "no smaller: the compensator did not act"
        return (
            f"1/{self.before / self.after:.0f}" if self.before > 2.5 * self.after else f"{self.after / self.before:.0%}"
        )

    @property
    def left(self) -> str:
        """The same in a sentence's end."""
        return f"{self.share} of it is left" if self.after <= UNCHANGED * self.before else self.share

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
        "name": "heave", "mode": "dof" if machine.is_hexapod else "actuator", "duration_s": FADE_s + at_full_size_s,
        "fade_s": FADE_s, "fade": "smooth", "axes": {axis: half_hertz_sine(machine)},
    }  # fmt: skip


def measured_heave(machine: Machine) -> dict[str, Any]:
    """The heave that the machine itself is driven in."""
    return heave(machine, PERIODS / FREQUENCY_Hz + FADE_s)


def start_parameters(twin: Machine, show: Callable[[float], None] = lambda share: None) -> list[Parameters]:
    """What the compensator learns of each leg of a simulated machine in heave.

    Where the file knows a rounding of the valve's edges it learns twice, the second time with that rounding and the delay
    anew: with 10 of 18 mV the bank of spools takes 0.6 ms of a slow spool's lag for delay.
    """
    duration_s = LEARNING_PLATFORM_s if twin.is_hexapod else LEARNING_s
    learned = simulate_twin(twin, scenario_from_dict(heave(twin, duration_s)), ALGORITHM, show).compensator_parameters
    known = with_rounding(with_null(learned, twin), twin)
    if known == learned:
        return with_delay(learned, twin)
    again = [own | {"delay": NO_DELAY} for own in known]
    learned = started(twin, again, duration_s, seed=1, show=show).compensator_parameters
    return with_delay(with_rounding(with_null(learned, twin), twin), twin)


def started(
    twin: Machine,
    learned: list[Parameters],
    duration_s: float,
    seed: int,
    show: Callable[[float], None] = lambda share: None,
) -> Run:
    """The heave of a twin whose compensator starts with what was learned."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / FILE
        write_json(place, {"compensator": ALGORITHM, "legs": learned})
        return simulate_twin(twin, scenario_from_dict(heave(twin, duration_s)), str(place), show, seed)


def with_null(learned: list[Parameters], machine: Machine) -> list[Parameters]:
    """Start parameters of a leg that leaks with the null of the machine file, the leak and the edges moved with it.

    Windows see the sum of a null and a leak, k (u - null) + leak, to 0.03 mV; the parts differ only while both edges are
    closed, and 15 passages with their noise leave 1.5 mV. The trace has held both against the logs. A null that drifts,
    a four-way valve and a platform's legs, on which that was not measured, keep what was learned.
    """
    rows, (_, travel, limit) = resolve(machine).rows, (machine.of_legs("valve", key) for key in KEYS)
    if machine.is_hexapod or machine.cylinder.rod_side == "valve":
        return learned
    found = []
    for own, row, volts_per_m in zip(learned, rows, limit / travel, strict=True):
        flow, steady = own["flow"], abs(row[P.NULL_DRIFT]) * LEARNING_s < STEADY_V and row[P.NULL_WARM_UP] == 0.0
        if flow["leak_m_s"] == 0.0 or not steady:
            found.append(own)
            continue
        out, back = flow["extend"], flow["retract"]
        null_V = row[P.NULL_OFFSET] + 0.5 * (row[P.OVERLAP_SUPPLY] - row[P.OVERLAP_TANK]) * volts_per_m
        off_V = null_V - flow["null_V"] - 0.5 * (out["dead_band_V"] - back["dead_band_V"])
        leak_m_s = off_V * 0.5 * (out["gain_m_s_V"] + back["gain_m_s_V"])
        edges = {"extend": shifted(out, off_V, leak_m_s), "retract": shifted(back, -off_V, -leak_m_s)}
        found.append(own | {"flow": flow | edges | {"leak_m_s": flow["leak_m_s"] + leak_m_s}})
    return found


def shifted(edge: dict[str, Any], off_V: float, velocity_m_s: float) -> dict[str, Any]:
    """What was learned of an edge that opens so much later: both fits have the product with its gain in their second place."""
    fits = {
        name: [theta + (velocity_m_s if k == 1 else 0.0) for k, theta in enumerate(edge[name])]
        for name in ("theta", "theta_backlash")
    }
    return edge | fits | {"dead_band_V": edge["dead_band_V"] + off_V}


def with_delay(learned: list[Parameters], twin: Machine) -> list[Parameters]:
    """Start parameters with the delays of the machine file, the valve's and the position's, where the twin's bump is smaller so.

    The compensator finds a delay with a bank of spools in steps of 0.3 ms: of a position that is 0.4 ms late it takes 0.2 ms,
    and half of the bump stays. The trace has held it against the logs. It is worth as much as the model of the spool beside
    it: so it is tried. Without a delay in the file, of a four-way valve and of a platform what was learned stays.
    """
    machine = resolve(twin)
    late_s = machine.leg_sensors["position_delay_s"]
    delay_s = machine.rows[:, P.VALVE_DELAY] + late_s
    if twin.is_hexapod or twin.cylinder.rod_side == "valve" or not np.all(delay_s > 0.0):
        return learned
    pairs = zip(learned, delay_s, late_s, strict=True)
    told = [own | {"delay": own["delay"] | {"told_s": [float(whole), float(late)]}} for own, whole, late in pairs]
    return told if twin_bump(twin, told) < UNCHANGED * twin_bump(twin, learned) else learned


def twin_bump(twin: Machine, learned: list[Parameters]) -> float:
    """Largest peak of a twin that starts with what was learned [m/s2], without its accelerometer's noise."""
    log = started(twin, learned, PERIODS / FREQUENCY_Hz + FADE_s, seed=2).log
    return worst(taken_apart(twin, log.with_columns(acceleration_m_s2=pl.col("true_acceleration_m_s2"))))


def with_rounding(learned: list[Parameters], machine: Machine) -> list[Parameters]:
    """Start parameters with the rounding of the valve's edges as the machine file has it [V at the spool].

    Beside a leak a heave hardly tells it: 10 of 18 mV, and half of the bump stays. The trace has held it against the logs.
    Where the file says nothing (sharp edges), and of a four-way valve, what was learned stays.
    """
    size, travel, limit = (machine.of_legs("valve", key) for key in KEYS)
    known = size * limit / travel
    if machine.cylinder.rod_side == "valve":
        return learned
    return [own | ({"rounding_V": float(V)} if V > 0.0 else {}) for own, V in zip(learned, known, strict=True)]


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
    even = np.arange(0.0, FADE_s + PERIODS / FREQUENCY_Hz, 1.0 / rate)
    return harmonic_deviation(even, np.interp(even, time, log[name].to_numpy()), FREQUENCY_Hz, start_s=FADE_s)
