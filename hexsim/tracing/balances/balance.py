"""What a balance is, and the measured point that the balances of a hydraulic leg share."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from threading import get_ident, local
from typing import ClassVar

import numpy as np

from hexsim.declaration import Machine
from hexsim.hydraulics.parameters import ROD_SIDE_SUPPLY, ROD_SIDE_VALVE, P
from hexsim.hydraulics.resolve import resolve
from hexsim.hydraulics.resolved import Resolved
from hexsim.signals.log import Log
from hexsim.signals.ripple import unrippled
from hexsim.signals.weak_form import WHOLE, Window, velocity
from hexsim.tracing.balances import spool
from hexsim.tracing.balances.bends import bends_at, kinks, tick_samples
from hexsim.tracing.memory import latest_of, remembered

Array = np.ndarray
# Offset, gain, delay [s] and lag [s] of a sensor; of a position three more, its scale's ripple.
Settings = tuple[float, ...]
FORCE_SIGNALS = (
    "velocity_m_s", "position_m", "acceleration_m_s2", "time_s", "pressure_bottom_Pa", "pressure_supply_Pa",
)  # fmt: skip


class Balance(ABC):
    """What must be zero where the model holds. All that the tool says of a balance stands in its class.

    name, unit: of the residual.  caption: what must be equal, for the report.  order: place in the order of tracing.
    signals: that the residual may depend on; of those that do alike the first is named: what the balance contains comes first.
    usual_signal: over which it is drawn where nothing stands out.
    learned_as: balance that a learned curve of its residual may join ("continuity", "force"), or None.
    other_names: name -> caption, for a residual that is put down to a part of it, see `reported_as`.
    spoils_others: where it is violated, no other can be trusted.  one_cause: its rows are one cause; the worst is looked at.
    shared_out: the balance whose rows these are, said in other places; none where empty.
    """

    name: ClassVar[str]
    unit: ClassVar[str]
    caption: ClassVar[str]
    order: ClassVar[int]
    signals: ClassVar[tuple[str, ...]] = FORCE_SIGNALS
    usual_signal: ClassVar[str] = "velocity_m_s"
    learned_as: ClassVar[str | None] = None
    other_names: ClassVar[dict[str, str]] = {}
    spoils_others: ClassVar[bool] = False
    one_cause: ClassVar[bool] = False
    shared_out: ClassVar[str] = ""

    @abstractmethod
    def needs(self, machine: Machine) -> tuple[tuple[str, ...], ...]:
        """Signals that a log must hold; of several sets any one does. () where such a machine has no such balance."""

    def wants(self, log: Log, machine: Machine) -> bool:
        """Is it formed of this log?"""
        return self.measurable(log, machine)

    def measurable(self, log: Log, machine: Machine) -> bool:
        """Has the machine this balance, and the log the channels?"""
        return any(all(log.signal(stem) is not None for stem in stems) for stems in self.needs(machine))

    def places(self, log: Log) -> list[str]:
        """Names of the rows: "leg 1", "all legs", "platform x"."""
        return [f"leg {i + 1}" for i in range(log.n_legs)]

    def residual(self, log: Log, machine: Machine) -> Array:
        """The residual under a window, a row a place: (n_places, n). A balance has this or `residual_at` of its own."""
        return self.residual_at(log, machine, WHOLE)

    def residual_at(self, log: Log, machine: Machine, at: slice) -> Array:
        """The same at some samples, (n_places, n_at): what fits ask for. A balance may do that for less."""
        return self.residual(log, machine)[:, at]

    def sampling(self, log: Log, machine: Machine) -> Array | None:
        """What of the residual rests on when the samples were taken, as `residual`: no violation of this size is one."""
        return None

    def noise_gains(self, resolved: Resolved) -> Array:
        """Gains (n_places,) of the transducers that make most of its noise; (1,) where they are one, or it does not matter.

        A gain that is taken out takes out noise too: undone, else a gain too large looks likelier.
        """
        return np.ones(1)

    def reported_as(self, signal: str) -> str:
        """The name under which a residual that depends on this signal is reported."""
        return self.name


@dataclass(frozen=True, kw_only=True, eq=False)
class SensedLeg:
    """What the sensors of one leg say, known gains, offsets, delays and lags taken out: (n,) each; under the window on demand."""

    y: Array
    v: Array
    P1: Array | None
    P2: Array | None  # of a rod side on the valve
    difference: Array | None  # P1 - P2, of a transducer across both
    acceleration: Array | None  # of a bench
    window: Window
    ticks: slice | None = None  # samples at which the controller sets new volts, where it leaves out some

    @cached_property
    def mean_y(self) -> Array:
        return self.window.mean(self.y)

    @cached_property
    def mean_v(self) -> Array:
        """<w, dy/dt>, from the position alone."""
        return self.window.rate(self.y)

    @cached_property
    def mean_P1(self) -> Array:
        assert self.P1 is not None
        return self.window.mean(self.P1)

    @cached_property
    def mean_P2(self) -> Array:
        assert self.P2 is not None
        return self.window.mean(self.P2)

    @cached_property
    def fast_v(self) -> Array:
        """Velocity for what is faster than the window: with what the samples miss of the accelerometer's mean [m/s]."""
        assert self.acceleration is not None
        return velocity(self.y, self.acceleration + kinks(self.acceleration, self.ticks), 1.0 / self.window.dt)

    def disagreement(self, at: slice = WHOLE) -> Array:
        """d2y/dt2 less what the accelerometer shows, under a wider window [m/s2]."""
        assert self.acceleration is not None
        wide = Window(1.0 / self.window.dt, 0.03, at)
        return wide.second_rate(self.y) - wide.mean(self.acceleration) - self.between_ticks(at)

    def between_ticks(self, at: slice = WHOLE) -> Array:
        """What the samples miss of the accelerometer's mean, under the wider window [m/s2]."""
        assert self.acceleration is not None
        return Window(1.0 / self.window.dt, 0.03, at).mean(kinks(self.acceleration, self.ticks))


@dataclass(frozen=True, kw_only=True, eq=False)
class MeasuredPoint:
    """Signals of one leg with the sensors' known gains taken out: (n,) each. Volts as they reach the spool."""

    sensed: SensedLeg
    volts: Array
    x: Array
    P2: Array | None
    Ps: Array
    t: Array

    @property
    def y(self) -> Array:
        return self.sensed.y

    @property
    def v(self) -> Array:
        return self.sensed.v

    @property
    def P1(self) -> Array | None:
        return self.sensed.P1


def leg_key(resolved: Resolved, leg: int, without: Sequence[int] = ()) -> Hashable:
    """All of a machine that a leg's measured point and its own terms depend on. without: places of its row that do not count."""
    row = resolved.rows[leg]
    if without:
        row = row.copy()
        row[list(without)] = 0.0
    return row.tobytes(), resolved.sensors.supply_pressure_gain, sensor_settings(resolved, leg)


def filter_delay_s(resolved: Resolved, channel: str) -> float:
    """Delay of slow motion behind a channel's declared low-pass, 1 / (2 pi f sin(pi/2n)): all of it that windows see."""
    cut_off, order = (getattr(resolved.sensors, f"{channel}_filter_{key}") for key in ("Hz", "order"))
    return 1.0 / (2.0 * np.pi * cut_off * np.sin(0.5 * np.pi / order)) if cut_off > 0.0 else 0.0


def channel_settings(resolved: Resolved, leg: int, channel: str, unit: str) -> Settings:
    """Offset, gain, delay with that of its filter, and lag of a transducer of a leg."""
    own = resolved.leg_sensors
    offset, gain, delay, lag = (
        float(own[f"{channel}_{k}"][leg]) for k in (f"offset_{unit}", "gain", "delay_s", "lag_s")
    )
    return offset, gain, delay + filter_delay_s(resolved, channel), lag


def position_settings(resolved: Resolved, leg: int) -> Settings:
    """Of the position sensor of a leg."""
    amplitude, pitch, phase = (float(number) for number in resolved.position_ripple[leg])
    return *channel_settings(resolved, leg, "position", "m"), amplitude, pitch, phase


def sensor_settings(resolved: Resolved, leg: int) -> tuple[Settings, Settings, Settings | None, Settings]:
    """Of the position, both pressures (None: no rod side on the valve) and the accelerometer that a leg's signals rest on."""
    shared, position = resolved.sensors, position_settings(resolved, leg)
    pressure = channel_settings(resolved, leg, "pressure", "Pa")
    on_valve = resolved.rows[leg, P.ROD_SIDE_CHAMBER] == ROD_SIDE_VALVE
    top = pressure if on_valve else None
    late = shared.acceleration_delay_s + filter_delay_s(resolved, "acceleration")
    motion = (shared.acceleration_offset_m_s2, shared.acceleration_gain, late, 0.0)
    return position, pressure, top, motion


def sensed_leg(log: Log, resolved: Resolved, leg: int) -> SensedLeg:
    """What the sensors of a leg say, computed once for a log and its sensors' settings."""
    settings = sensor_settings(resolved, leg)
    rate_Hz = resolved.machine.controller.rate_Hz
    sense = partial(_sense, log, leg, *settings)
    return latest_of(log, ("sensed", leg), settings, lambda: sense(tick_samples(log, leg, rate_Hz)))


def _sense(
    log: Log,
    leg: int,
    position: Settings,
    pressure: Settings,
    top: Settings | None,
    motion: Settings,
    ticks: slice | None,
) -> SensedLeg:
    def true_of(shown: Array, settings: Settings) -> Array:
        offset, gain, delay, lag, *ripple = settings
        signal = (shown - offset) / gain
        sharp = signal + lag * log.rate * np.gradient(signal) if lag else signal  # s = f + tau df/dt, see signals.lag
        there = advanced(sharp, delay * log.rate)
        return unrippled(there, *ripple) if ripple and ripple[0] else there

    y = true_of(log.position[leg], position)
    acceleration = None
    if log.n_legs == 1 and log.acceleration is not None:
        acceleration = true_of(log.acceleration[0], motion)
    P1 = None if log.pressure is None else true_of(log.pressure[leg], pressure)
    rod_side = log.signal("pressure_top")
    difference = log.signal("pressure_difference")
    P2 = None if top is None or rod_side is None else true_of(rod_side[leg], top)
    v = velocity(y, acceleration, log.rate)
    if acceleration is not None and ticks is not None and log.volts is not None:
        ticks = bends_at(acceleration, log.volts[leg], ticks)
    return SensedLeg(
        y=y,
        v=v,
        P1=P1,
        P2=P2,
        difference=None if difference is None else difference[leg],
        acceleration=acceleration,
        window=Window(log.rate),
        ticks=ticks,
    )


def measured_point(log: Log, machine: Machine, resolved: Resolved, leg: int) -> MeasuredPoint:
    """The point at which the balances of a leg are evaluated."""
    row = resolved.rows[leg]
    t = log.run_time
    last = remembered(log, ("spool", leg, get_ident()), dict)  # fits vary one number after the other
    key = tuple(row[place] for place in spool.OF_SPOOL)
    if key not in last:
        last.clear()
        last[key] = spool.at_samples(row, np.zeros(log.n) if log.volts is None else log.volts[leg], t, log.rate)
    held, x = last[key]
    supply = np.full(log.n, row[P.SUPPLY_PRESSURE])
    if log.supply is not None:
        supply = log.supply / resolved.sensors.supply_pressure_gain
    sensed = sensed_leg(log, resolved, leg)
    P2 = sensed.P2 if row[P.ROD_SIDE_CHAMBER] == ROD_SIDE_VALVE else supply
    return MeasuredPoint(sensed=sensed, volts=held, x=x, P2=P2, Ps=supply, t=t)


def advanced(signal: Array, samples: float) -> Array:
    """A late channel shifted back to where it belongs."""
    if samples == 0.0:
        return signal
    place = np.arange(signal.shape[-1])
    return np.interp(place + samples, place, signal)


_latest = local()


def resolved_machine(machine: Machine) -> Resolved:
    """A machine with its effects, a rod side that is not on the valve at supply pressure. Read it, do not change it.

    The latest is kept: one balance after the other asks for the same machine.
    """
    if getattr(_latest, "machine", None) is not machine:
        resolved = resolve(machine)
        on_valve = resolved.rows[:, P.ROD_SIDE_CHAMBER] == ROD_SIDE_VALVE
        resolved.rows[~on_valve, P.ROD_SIDE_CHAMBER] = ROD_SIDE_SUPPLY
        _latest.machine, _latest.resolved = machine, resolved
    return _latest.resolved
