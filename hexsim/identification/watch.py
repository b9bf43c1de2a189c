"""The host's own watch over a machine that it drives: it may have no monitors, or none that act.

Each row of telemetry is held against what the declaration expects, with a margin of a factor of two:

    lag          y_m' = K_v sat(K_p (s - y_m)), the loop as declared, with half of K_v, with K_v and with twice; the piston
                 stands among s and these three, or beside them by what `hold_share` of the largest volts may hold
    pace         while the piston is farther from its setpoint than that, it goes towards it with half of the declared speed at
                 least, K_v K_p (|s - y| - hold)
    encoder      a reading that repeats itself to the bit while its setpoint moves on by more than the valve's dead band
    end stop     a piston within a fifth of the margin that setpoints keep from the cushions
    setpoint     what the machine says it follows is what the host has sent within `LATE_s`
    pressures    the supply gives the valve half its flow at least, sqrt(P / P_s) = 1/2; a chamber carries its rod side
    acceleration the limit of setpoints and the jolt of friction at a reversal, 2 F / m, twice
"""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from hexsim.declaration import Machine
from hexsim.motion_computer.host_limiter import HostLimiter, PERIOD_s
from hexsim.motion_computer.limits import LEG_MARGIN_m
from hexsim.motion_computer.monitors import velocity_gain
from hexsim.motion_computer.telemetry import Telemetry

Array = NDArray[np.float64]
MARGIN = 2.0  # on the lag, the flow, the pressure and the acceleration that the declaration lets expect
LATE_s = 0.3  # by which a machine may follow the host later


class Watch:
    """Looks at a machine's telemetry while it is driven; `look` and `silent` say what is wrong, or nothing."""

    def __init__(
        self,
        machine: Machine,
        limiter: HostLimiter,
        *,
        hold_share: float = 0.04,  # of the largest volts: null, hysteresis, threshold and leak of a servo valve and its leg, 1 % each
        threshold_share: float = 0.01,  # of the largest volts: a servo valve answers to less
    ) -> None:
        self.machine, self.limiter = machine, limiter
        of_legs, legs = machine.of_legs, machine.legs
        self.n = machine.n_legs
        self.stroke = of_legs("cylinder", "stroke_m")
        self.gain_V_per_m, self.volts = of_legs("controller", "gain_V_per_m"), of_legs("valve", "voltage_max_V")
        self.velocity_gain = np.outer([1.0 / MARGIN, 1.0, MARGIN], velocity_gain(machine))
        overlap = of_legs("valve", "overlap_m") * self.volts / of_legs("valve", "spool_travel_max_m")
        self.dead_m = overlap / self.gain_V_per_m
        self.hold_m = self.dead_m + hold_share * self.volts / self.gain_V_per_m
        self.threshold_m = threshold_share * self.volts / self.gain_V_per_m
        supply_Pa = machine.supply.pressure_Pa
        self.supply_low_Pa = supply_Pa / MARGIN**2
        rod = of_legs("cylinder", "area_top_m2") / of_legs("cylinder", "area_bottom_m2")
        on_supply = machine.cylinder.rod_side == "supply"
        self.carry_Pa = rod * supply_Pa / MARGIN if on_supply else np.full(self.n, -np.inf)
        friction = sum(
            max(leg.friction.coulomb_extend_N, leg.friction.coulomb_retract_N)
            + max(leg.friction.static_extend_N, leg.friction.static_retract_N)
            for leg in legs
        )
        jolt = 2.0 * friction / machine.load.carried_mass_kg
        self.jolt_m_s2 = MARGIN * (machine.host_limits.acceleration_m_s2 + jolt)
        self._sent: deque[Array] = deque(maxlen=round(LATE_s / PERIOD_s))  # legs' setpoints (n,) from neutral
        self._models: Array | None = None  # (3, n) positions
        self._last, self._since = np.full(self.n, np.nan), np.zeros(self.n)  # reading, setpoint where it began
        self._away, self._from_m, self._due_m = (
            np.zeros(self.n),
            np.zeros(self.n),
            np.zeros(self.n),
        )  # sign, reading, way
        self._equal_s, self._bad_s = np.zeros(self.n), dict[str, Array]()
        self._next_s, self._rows, self._waited_s = 0.0, 0, 0.0
        self._zero, self._felt = np.zeros(3), np.zeros(3)

    def sent(self, row: Array) -> None:
        """A row (6,) of setpoints that has left the host."""
        self._sent.append(self.limiter.coordinates(row[None])["leg"][0])

    def silent(
        self,
        came: bool | int,
        *,
        silent_s: float = 1.0,  # without telemetry
    ) -> str:
        """After each packet of the host: whether telemetry came, or no reply either, which the link judges."""
        self._waited_s = 0.0 if came else self._waited_s + PERIOD_s
        return f"no telemetry has come for {silent_s:g} s" if self._waited_s > silent_s else ""

    def look(self, packet: Telemetry) -> str:
        """What is wrong, in words that name leg and reading; nothing where all is as it must be."""
        if packet.n_legs != self.n:
            return f"the machine sends {packet.n_legs} legs, and {self.machine.name} is declared with {self.n}"
        for k, row in enumerate(packet.rows):
            time_s, step_s = packet.time_s + k / packet.rate_Hz, 1.0 / packet.rate_Hz
            if self._models is not None:  # rows that were lost on the way took their time too
                step_s = min(max(time_s - self._next_s, 0.0) + step_s, LATE_s)
            self._next_s = time_s + 1.0 / packet.rate_Hz
            if found := self._row(row, step_s):
                return found
        return ""

    def _row(
        self,
        row: Array,
        step_s: float,
        *,
        stop_share: float = 0.2,  # of `LEG_MARGIN_m`
        range_share: float = 0.02,  # of the stroke, beyond which a reading is no position
        noticed_s: float = 0.02,  # so long must it be seen: a single reading is no finding
    ) -> str:
        n = self.n
        setpoint, position, bottom = row[:n], row[n : 2 * n], row[2 * n : 3 * n]
        supply_Pa, acceleration = row[5 * n], row[5 * n + 1 : 5 * n + 4]
        if self._models is None:
            self._models = np.tile(np.where(np.isfinite(position), position, setpoint), (len(self.velocity_gain), 1))
        lost = ~np.isfinite(position) | ~np.isfinite(setpoint)
        if not lost.any():
            self._models = self._followed(self._models, setpoint, step_s)
        low, high = np.minimum(setpoint, self._models.min(axis=0)), np.maximum(setpoint, self._models.max(axis=0))
        stop_m = stop_share * LEG_MARGIN_m
        neutral = self.limiter.mechanics.neutral_positions
        sent = np.array(self._sent) if self._sent else np.zeros((1, n))
        wanted = setpoint - neutral
        judged = {
            "lost": lost,
            "range": (position < -range_share * self.stroke) | (position > (1.0 + range_share) * self.stroke),
            "stop": (position < stop_m) | (position > self.stroke - stop_m),
            "setpoint": (wanted < sent.min(axis=0) - self.hold_m) | (wanted > sent.max(axis=0) + self.hold_m),
            "lag": (position < low - self.hold_m) | (position > high + self.hold_m),
            "pace": np.zeros(n, bool) if lost.any() else self._pace(setpoint, position, step_s),
            "carry": bottom < self.carry_Pa,
            "supply": np.array([supply_Pa < self.supply_low_Pa]),
            "jolt": np.array([self._jolt(acceleration, step_s)]),
        }
        for name, bad in judged.items():
            held = self._bad_s[name] = np.where(bad, self._bad_s.get(name, 0.0) + step_s, 0.0)
            if (held > noticed_s).any():
                return self._words(name, int(np.argmax(held > noticed_s)), row, low, high)
        return "" if lost.any() else self._frozen(setpoint, position, step_s)

    def _pace(
        self,
        setpoint: Array,
        position: Array,
        step_s: float,
        *,
        delay_s: float = 0.03,  # of valve and transducer, which the pace forgives
    ) -> Array:
        """Which pistons do not go towards their setpoints."""
        error = setpoint - position
        away = np.where(np.abs(error) > self.hold_m, np.sign(error), 0.0)
        begins = away != self._away
        self._away = away
        self._from_m = np.where(begins, position, self._from_m)
        volts = np.minimum(self.gain_V_per_m * (np.abs(error) - self.hold_m), self.volts)
        self._due_m = np.where(begins | (away == 0.0), 0.0, self._due_m + step_s * self.velocity_gain[0] * volts)
        late_m = delay_s * self.velocity_gain[1] * self.gain_V_per_m * self.hold_m  # what it goes before it turns
        return (away != 0.0) & (self._due_m - away * (position - self._from_m) > late_m)

    def _followed(self, models: Array, setpoint: Array, step_s: float) -> Array:
        """The loop's models a step later; small steps, so that lost rows do not make them diverge."""
        steps = max(round(step_s / 2e-3), 1)
        for _ in range(steps):
            volts = np.clip(self.gain_V_per_m * (setpoint - models), -self.volts, self.volts)
            models = models + step_s / steps * self.velocity_gain * volts
        return models

    def _frozen(
        self,
        setpoint: Array,
        position: Array,
        step_s: float,
        *,
        equal_s: float = 0.1,  # so long must a reading repeat itself
    ) -> str:
        same = position == self._last
        self._equal_s = np.where(same, self._equal_s + step_s, 0.0)
        self._since = np.where(same, self._since, setpoint)
        self._last = position.copy()
        moved = np.abs(setpoint - self._since)
        frozen = (self._equal_s > equal_s) & (moved > MARGIN * self.dead_m + self.threshold_m)
        if not frozen.any():
            return ""
        leg = int(np.argmax(frozen))
        return (
            f"leg {leg + 1}: its position reads {1e3 * position[leg]:.3f} mm without any change for {self._equal_s[leg]:.2f} s, "
            f"while its setpoint moved by {1e3 * moved[leg]:.1f} mm: the encoder is frozen, or the leg is stuck"
        )

    def _jolt(
        self,
        acceleration: Array,
        step_s: float,
        *,
        averaged_s: float = 0.02,  # of the acceleration: its noise is no jolt
        standing_s: float = 0.2,  # at the beginning, in which an accelerometer shows its zero, gravity included
    ) -> bool:
        """Whether the platform feels more than its motion and its friction can give."""
        felt = np.where(np.isfinite(acceleration), acceleration, 0.0)
        self._rows += 1
        if self._rows * step_s <= standing_s:
            self._zero += (felt - self._zero) / self._rows
            return False
        self._felt += step_s / (averaged_s + step_s) * (felt - self._zero - self._felt)
        return float(np.linalg.norm(self._felt)) > self.jolt_m_s2

    def _words(self, name: str, leg: int, row: Array, low: Array, high: Array) -> str:
        n = self.n
        at, setpoint = 1e3 * row[n + leg] if leg < n else 0.0, 1e3 * row[leg]
        stroke = 1e3 * self.stroke[leg]
        if name == "lost":
            return f"leg {leg + 1}: its position reads {row[n + leg]:g} and its setpoint {row[leg]:g}"
        if name == "range":
            return f"leg {leg + 1}: its position reads {at:.1f} mm, outside its stroke of {stroke:g} mm"
        if name == "stop":
            return f"leg {leg + 1} is at its end stop: {at:.1f} mm of {stroke:g} mm, while its setpoint is {setpoint:.1f} mm"
        if name == "lag":
            band = f"{1e3 * low[leg]:.1f} and {1e3 * high[leg]:.1f} mm"
            return (
                f"leg {leg + 1} does not follow its setpoint: it stands at {at:.1f} mm, and its loop as declared would have "
                f"it between {band}: a valve that is stuck, or a transducer that is wrong"
            )
        if name == "pace":
            moved = 1e3 * float(self._away[leg]) * (row[n + leg] - self._from_m[leg])
            return (
                f"leg {leg + 1} does not follow its setpoint: from {1e3 * self._from_m[leg]:.1f} mm it went {moved:.1f} mm towards "
                f"{setpoint:.1f} mm, and half the declared speed is {1e3 * self._due_m[leg]:.1f} mm: a valve that is stuck, or a "
                "transducer that is wrong"
            )
        if name == "setpoint":
            return (
                f"leg {leg + 1}: the machine says that its setpoint is {setpoint:.1f} mm, which the host has not sent within "
                f"{LATE_s:g} s: its telemetry is not of this motion, or its own limits are tighter (--largest)"
            )
        if name == "carry":
            return (
                f"leg {leg + 1}: its bottom pressure is {1e-5 * row[2 * n + leg]:.1f} bar, and its rod side alone needs "
                f"{1e-5 * MARGIN * self.carry_Pa[leg]:.1f} bar"
            )
        if name == "supply":
            return f"the supply is at {1e-5 * row[5 * n]:.1f} bar, declared {1e-5 * self.machine.supply.pressure_Pa:.1f} bar"
        return (
            f"the acceleration is {np.linalg.norm(self._felt):.1f} m/s2, and the motion with the friction of its legs can give "
            f"{self.jolt_m_s2 / MARGIN:.1f} m/s2"
        )
