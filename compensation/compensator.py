"""What a compensator is: what it is given at each tick, what it may know, what it returns.

The motion computer closes a position loop per actuator, ``u = Kp (setpoint - position)``. A compensator adds volts to
that, ``u_valve = saturate(u + u_c)``, so that the valve's non-linearity and the friction are not felt on the platform.
It runs at the rate of the motion computer (500 Hz). It knows only what a motion computer knows: setpoints and their
preview, transducers, its own output and a data sheet.

A compensator's instance holds its configuration and nothing else. What it learns lives in the state that `start` makes
and `step` returns, so that one instance may serve six actuators. A state may be updated in place; its caller owns it.
"""

from __future__ import annotations

import abc
import math
from collections.abc import Iterable
from dataclasses import dataclass, field, fields, is_dataclass
from functools import cache, cached_property
from typing import Any, ClassVar

import numpy as np

from .knowledge import Knowledge

NO_LOAD = np.zeros(0)  # `Sample.load_preview_m_s2` of a leg that carries nothing of what other legs move
MOST_LEGS = 8  # of a platform
MEASURED_TICKS = 5  # by which `Sample.speeds_m_s` lie behind: the middle of the parabola they come from
Parameters = dict[str, Any]  # numbers, lists of numbers, strings: what JSON and TOML can hold


@dataclass(slots=True)
class Sample:
    """What the motion computer has at one tick, for one actuator.

    Scalars of any kind, numpy's too, become floats: an algorithm computes in double precision whoever calls it.
    """

    time_s: float
    setpoint_m: (
        float  # piston position that the controller compares with, behind its setpoint filter; 0 at full retraction
    )
    preview_m: (
        np.ndarray
    )  # (n,) before it: demanded at this tick and the next n - 1 ticks, n = 1 + round(preview_s * rate)
    position_m: float  # measured, with noise and quantisation
    control_V: float  # output of the controller at this tick, Kp (setpoint - position) and what else it has
    valve_V: float  # total sent to the valve at the previous tick, after saturation
    pressure_bottom_Pa: float  # measured, P1 of the report
    pressure_supply_Pa: float  # measured, Ps
    feed_forward_V: float = 0.0  # part of control_V that is of the setpoint alone, but for Kp (setpoint - position)
    pressure_top_Pa: float = 0.0  # measured, of a rod side on a four-way valve
    # (n,) or none: load that the setpoints of all legs give this one, over the mass that it has when all move alike
    load_preview_m_s2: np.ndarray = field(default_factory=lambda: NO_LOAD)
    # of a platform's legs `MEASURED_TICKS` ago, for a compensator that `feels_legs`: P1 A1 - P2 A2 (n,), speeds (n,), this one's
    # load by pose and speeds, over that mass, and its acceleration for a force on each leg over that for a force on its own (n,)
    forces_N: np.ndarray = field(default_factory=lambda: NO_LOAD)
    speeds_m_s: np.ndarray = field(default_factory=lambda: NO_LOAD)
    load_of_pose_m_s2: float = 0.0
    mobility: np.ndarray = field(default_factory=lambda: NO_LOAD)

    def __post_init__(self) -> None:
        floats = (
            type(self.time_s)
            is type(self.setpoint_m)
            is type(self.position_m)
            is type(self.control_V)
            is type(self.valve_V)
            is type(self.pressure_bottom_Pa)
            is type(self.pressure_supply_Pa)
            is float
        )
        if not floats:
            for name in (
                "time_s",
                "setpoint_m",
                "position_m",
                "control_V",
                "valve_V",
                "pressure_bottom_Pa",
                "pressure_supply_Pa",
            ):
                setattr(self, name, float(getattr(self, name)))


@dataclass(frozen=True, kw_only=True)
class Context:
    """Data-sheet knowledge an engineer enters. Overlap, friction and discharge coefficient are not among it.

    `period_s` is known when the built-in signal generator drives the machine and None when a host does.
    """

    rate_Hz: float = 500.0
    position_gain_V_per_m: float = 50.0
    voltage_max_V: float = 10.0
    stroke_m: float = 0.2
    area_bottom_m2: float = math.pi / 4 * 0.04**2
    area_top_m2: float = math.pi / 4 * (0.04**2 - 0.03**2)
    supply_pressure_Pa: float = 7.0e6
    tank_pressure_Pa: float = 0.0
    bulk_modulus_Pa: float = 1.5e9
    pipeline_volume_m3: float = 5.0e-7
    four_way: bool = False  # the rod side is a chamber on the valve; else the supply acts on it
    pipeline_volume_top_m3: float = 0.0  # of that chamber
    position_noise_m: float = 3.0e-6
    position_resolution_m: float = 3.0e-6
    pressure_noise_Pa: float = 4.0e3
    pressure_resolution_Pa: float = 0.0
    spool_damping: float = 0.7  # common of proportional valves
    spool_frequency_Hz: float = 0.0  # 0: not declared
    stribeck_velocity_m_s: float = 5.0e-3  # over which friction falls after breakaway; a common size
    edge_V: float = (
        0.5  # what overlap, leak and friction can ask of the valve (volts_bound.py); a twentieth of the range
    )
    velocity_gain_m_s_V: float = 0.15  # of the piston at half the supply pressure, beyond the overlap
    velocity_gain_V_s_per_m: float = 0.0  # feedback of the controller beside its gain, and its filters
    velocity_filter_Hz: float = 60.0
    pressure_gain_V_per_Pa: float = 0.0
    pressure_high_pass_Hz: float = 1.0
    # of a platform, by its geometry and body; legs that differ in these are alike
    # share of its mass that a leg moves by itself, the others' forces held; (n,) acceleration by each leg's force, over that by its own
    own_mobility: float = field(default=1.0, compare=False)
    mobility: tuple[float, ...] = field(default=(), compare=False)
    leg: int = field(default=0, compare=False)  # from 0
    load_over_weight: float = field(default=1.0, compare=False)  # that mass times gravity over the force that holds it
    controller_feeds_forward: bool = False  # the plain controller follows the setpoint without the lag of its gain
    period_s: float | None = None

    def __post_init__(self) -> None:
        positive = (
            "rate_Hz",
            "position_gain_V_per_m",
            "voltage_max_V",
            "stroke_m",
            "area_bottom_m2",
            "area_top_m2",
            "supply_pressure_Pa",
            "bulk_modulus_Pa",
            "spool_damping",
            "stribeck_velocity_m_s",
            "edge_V",
            "velocity_gain_m_s_V",
        )
        for name in positive:
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise ValueError(
                    f"context {name} is {value}; it must be a finite number above zero: mend the machine file"
                )
        if self.period_s is not None and not (math.isfinite(self.period_s) and self.period_s > 0):
            raise ValueError(
                f"context period_s is {self.period_s}; give the period [s] of the motion, or None where it is not known"
            )

    @cached_property
    def tick_s(self) -> float:
        """Control period [s]."""
        return 1.0 / self.rate_Hz

    @cached_property
    def legs(self) -> int:
        """How many legs carry the platform; 0 of a bench."""
        return len(self.mobility)

    @cached_property
    def position_error_m(self) -> float:
        """Standard deviation of a position read: noise, and a count's width over sqrt(12)."""
        return math.hypot(self.position_noise_m, self.position_resolution_m / math.sqrt(12.0))

    @cached_property
    def pipeline_length_m(self) -> float:
        """Travel of the piston that displaces the pipeline's volume."""
        return self.pipeline_volume_m3 / self.area_bottom_m2

    @cached_property
    def velocity_pole(self) -> float:
        """Of w s/(s + w) by the bilinear rule."""
        return _first_order(self.velocity_filter_Hz, self.rate_Hz)[0]

    @cached_property
    def velocity_share(self) -> float:
        """Gain of the same for a change within a tick [1/s]."""
        return 2.0 * math.pi * self.velocity_filter_Hz * _first_order(self.velocity_filter_Hz, self.rate_Hz)[1]

    @cached_property
    def pressure_pole(self) -> float:
        """Of s/(s + w) by the bilinear rule."""
        return _first_order(self.pressure_high_pass_Hz, self.rate_Hz)[0]

    @cached_property
    def pressure_share(self) -> float:
        """Gain of the same for a change within a tick."""
        return _first_order(self.pressure_high_pass_Hz, self.rate_Hz)[1]

    def compliance_m_Pa(self, position_m: float) -> float:
        """Travel by which the oil below the piston is compressed, per pressure: V / (E A1) (Eq. 3.7)."""
        return (position_m + self.pipeline_length_m) / self.bulk_modulus_Pa


def _first_order(corner_Hz: float, rate_Hz: float) -> tuple[float, float]:
    """(pole, share) of s/(s + w) by the bilinear rule: y_k = pole y_(k-1) + share (x_k - x_(k-1))."""
    fast, slow = 2.0 * rate_Hz, 2.0 * math.pi * corner_Hz
    return (fast - slow) / (fast + slow), fast / (fast + slow)


class Compensator(abc.ABC):
    """Interface of every compensation algorithm; subclasses are frozen dataclasses of their configuration.

    The contract, which tests/compensation/test_contract.py holds every registered algorithm to: the volts are finite
    whatever the sample holds, bounded by the voltage range, zero at first and faded in; parameters survive JSON.

    A subclass in a module of this package is listed by its `name` with no further entry anywhere. The first paragraph
    of its docstring is its description in lists.
    """

    name: str = ""
    preview_s: float = 0.0
    variants: ClassVar[dict[str, dict[str, Any]]] = {}  # further names, each with its configuration
    place: ClassVar[int] = 100  # in lists, the lowest first
    feels_legs: ClassVar[bool] = False  # whether a sample of a platform must say what all legs do

    @abc.abstractmethod
    def start(self, context: Context) -> Any:
        """A fresh state, with nothing learned."""

    @abc.abstractmethod
    def step(self, state: Any, sample: Sample) -> tuple[float, Any]:
        """Volts to add to `sample.control_V` at this tick, and the state for the next."""

    @abc.abstractmethod
    def parameters(self, state: Any) -> Parameters:
        """What was learned, as numbers and lists that JSON and TOML can hold."""

    @abc.abstractmethod
    def restore(self, context: Context, parameters: Parameters) -> Any:
        """A state that starts with what was learned before."""

    def resume(self, context: Context, parameters: Parameters) -> Any:
        """The same in the middle of a motion, after a fault."""
        return self.restore(context, parameters)

    def preview_of(self, state: Any) -> float:
        """Preview [s] that a state looks at, at most `preview_s`. A host that knows no future has to predict as much."""
        return self.preview_s

    def tells(self, state: Any) -> bool:
        """Whether the last step has something that the other legs of the same machine may `hear`."""
        return False

    def hear(self, state: Any, other: Any) -> None:
        """Take what `other`, the state of a leg that is alike and `tells`, has just learned, and how far it is with engaging."""
        return

    def status(self, state: Any) -> str:
        """Empty, or a sentence for the log, such as why plain control acts alone."""
        return ""

    def not_engaged(self, state: Any) -> str:
        """Empty while the algorithm adds its volts; else which criterion keeps it out, in words and numbers. An algorithm that
        does not say is taken to be engaged from its first tick on."""
        return ""

    def knows(self, state: Any) -> Knowledge | None:
        """What is known of the leg, with errors; None of an algorithm that has no model of it, or not yet."""
        return None

    def refused(self, context: Context, parameters: Parameters) -> str:
        """Empty, or why finite parameters of the right shape cannot be this machine's: a number out of its physical range, or two
        that contradict each other. `learned_parameters.check_parameters` asks before `restore`."""
        return ""

    def finite(self, state: Any) -> bool:
        """Whether every number of a state is finite; else the guard leaves to plain control, and the algorithm starts anew.

        Looks into dataclasses, lists, tables and arrays. An algorithm that holds a NaN on purpose says for itself what is sound.
        """
        return all_finite(state)

    @property
    def description(self) -> str:
        """One or two sentences for lists: what the algorithm is, and how a variant is configured."""
        text = " ".join((type(self).__doc__ or "").split("\n\n")[0].split())
        settings = ", ".join(f"{key} {value}" for key, value in self.variants.get(self.name, {}).items())
        return f"{text} ({settings})" if settings else text


@dataclass(frozen=True)
class Wrapped(Compensator):
    """A compensator around another one, under its name; what a subclass does not change is the other's."""

    inner: Compensator

    @property
    def name(self) -> str:  # type: ignore[override]
        """The algorithm's own name."""
        return self.inner.name

    @property
    def preview_s(self) -> float:  # type: ignore[override]
        """The algorithm's own preview [s]."""
        return self.inner.preview_s

    @property
    def feels_legs(self) -> bool:  # type: ignore[override]
        """Whether the algorithm needs to."""
        return self.inner.feels_legs

    @property
    def description(self) -> str:
        """The algorithm's own description."""
        return self.inner.description

    def start(self, context: Context) -> Any:
        return self.inner.start(context)

    def step(self, state: Any, sample: Sample) -> tuple[float, Any]:
        return self.inner.step(state, sample)

    def parameters(self, state: Any) -> Parameters:
        return self.inner.parameters(state)

    def restore(self, context: Context, parameters: Parameters) -> Any:
        return self.inner.restore(context, parameters)

    def resume(self, context: Context, parameters: Parameters) -> Any:
        return self.inner.resume(context, parameters)

    def preview_of(self, state: Any) -> float:
        return self.inner.preview_of(state)

    def tells(self, state: Any) -> bool:
        return self.inner.tells(state)

    def hear(self, state: Any, other: Any) -> None:
        self.inner.hear(state, other)

    def status(self, state: Any) -> str:
        return self.inner.status(state)

    def not_engaged(self, state: Any) -> str:
        return self.inner.not_engaged(state)

    def knows(self, state: Any) -> Knowledge | None:
        return self.inner.knows(state)

    def refused(self, context: Context, parameters: Parameters) -> str:
        return self.inner.refused(context, parameters)

    def finite(self, state: Any) -> bool:
        return self.inner.finite(state)


def all_finite(value: Any) -> bool:
    """Whether every number within dataclasses, lists, tuples, tables and arrays is finite; a `Context` is."""
    if isinstance(value, float):
        return math.isfinite(value)
    if isinstance(value, np.ndarray):
        return value.dtype.kind not in "fc" or bool(np.isfinite(value).all())
    if isinstance(value, list | tuple):
        if _has_finite_sum(value):
            return True
        parts: Iterable[Any] = value
    elif isinstance(value, dict):
        parts = value.values()
    else:
        parts = [getattr(value, name) for name in _fields_of(type(value))]
    for part in parts:  # called at each tick: plain loops, and most parts are plain numbers
        if type(part) is float:
            if not math.isfinite(part):
                return False
        elif type(part) not in SOUND and not all_finite(part):
            return False
    return True


SOUND = (int, bool, str, type(None))


@cache
def _fields_of(kind: type) -> tuple[str, ...]:
    """Names of a dataclass' fields, of a `Context` and of anything else none: asked for at each tick."""
    if not is_dataclass(kind) or issubclass(kind, Context | type):
        return ()
    return tuple(each.name for each in fields(kind))


def _has_finite_sum(values: list[Any] | tuple[Any, ...]) -> bool:
    """Whether these are plain numbers with a finite sum, and so all finite: quicker by far than one by one."""
    if not values or type(values[0]) not in (float, int):
        return False
    try:
        return math.isfinite(sum(values))
    except (TypeError, ValueError, OverflowError):  # others among them
        return False


def clip(value: float, low: float, high: float) -> float:
    """`value` held between `low` and `high`; a NaN becomes `low`."""
    if value > high:
        return high
    return value if value > low else low


def preview_count(compensator: Compensator, context: Context, state: Any = None) -> int:
    """How many setpoints `Sample.preview_m` holds for this compensator, or for the state that it starts with."""
    seconds = compensator.preview_s if state is None else compensator.preview_of(state)
    return 1 + round(seconds * context.rate_Hz)
