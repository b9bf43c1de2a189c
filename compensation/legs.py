"""All legs of a machine at one tick: what they are given in arrays, and one algorithm that steps them together.

`Guarded.together` makes the stepper. It gives what `Guarded.step`, leg by leg, gives, to the bit; an algorithm with a compiled
tick of its own says by `together` how all its legs are stepped in one call.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from .compensator import Compensator, Sample


@dataclass(slots=True)
class Legs:
    """`Sample` of all legs: arrays of double precision in rows, one a leg; `counts` of a row's preview are its leg's."""

    time_s: float
    setpoint_m: np.ndarray  # (n_legs,)
    preview_m: np.ndarray  # (n_legs, most)
    counts: np.ndarray  # (n_legs,) integers
    position_m: np.ndarray
    control_V: np.ndarray
    valve_V: np.ndarray
    pressure_bottom_Pa: np.ndarray
    pressure_supply_Pa: float
    feed_forward_V: np.ndarray
    pressure_top_Pa: np.ndarray
    load_preview_m_s2: np.ndarray  # (n_legs, most), or (n_legs, 0)
    forces_N: np.ndarray  # (n_legs,) of all legs, or none
    speeds_m_s: np.ndarray
    load_of_pose_m_s2: np.ndarray  # (n_legs,)
    mobility: np.ndarray  # (n_legs, n_legs), or (n_legs, 0)

    def samples(self) -> list[Sample]:
        """One sample a leg."""
        of_legs = np.array(
            (
                self.setpoint_m,
                self.position_m,
                self.control_V,
                self.valve_V,
                self.pressure_bottom_Pa,
                self.feed_forward_V,
                self.pressure_top_Pa,
                self.load_of_pose_m_s2,
            )
        ).T.tolist()
        counts, preview, loads, mobility = self.counts.tolist(), self.preview_m, self.load_preview_m_s2, self.mobility
        return [
            Sample(
                self.time_s,
                setpoint,
                preview[i, : counts[i]],
                position,
                volts,
                valve,
                bottom,
                self.pressure_supply_Pa,
                forward,
                top,
                loads[i, : counts[i]],
                self.forces_N,
                self.speeds_m_s,
                carried,
                mobility[i],
            )
            for i, (setpoint, position, volts, valve, bottom, forward, top, carried) in enumerate(of_legs)
        ]


class Together(Protocol):
    """The states of all legs of one algorithm."""

    may_speak: bool  # whether a leg's `status` may be another one than at the tick before

    def step(self, legs: Legs, acts: np.ndarray, added: np.ndarray, finite: np.ndarray) -> None:
        """The volts of those legs that act (n_legs,), and whether their states are finite, into `added` and `finite`."""
        ...

    def renew(self, leg: int, state: Any) -> None:
        """A leg goes on with another state."""
        ...

    def share(self, acted: np.ndarray, alike: np.ndarray) -> None:
        """What legs have just learned, to those that are alike (n_legs, n_legs)."""
        ...


class OneByOne:
    """An algorithm in Python, leg by leg."""

    def __init__(self, algorithm: Compensator, states: Sequence[Any]) -> None:
        self.algorithm, self.states = algorithm, list(states)
        kind = type(algorithm)
        self.may_speak = kind.status is not Compensator.status
        self._tells = kind.tells is not Compensator.tells

    def step(self, legs: Legs, acts: np.ndarray, added: np.ndarray, finite: np.ndarray) -> None:
        made, states = self.algorithm, self.states
        for i, sample in enumerate(legs.samples()):
            if acts[i]:
                volts, states[i] = made.step(states[i], sample)
                added[i], finite[i] = volts, made.finite(states[i])

    def renew(self, leg: int, state: Any) -> None:
        self.states[leg] = state

    def share(self, acted: np.ndarray, alike: np.ndarray) -> None:
        if self._tells:
            tell([self.algorithm] * len(self.states), self.states, acted, alike)


OF_A_LEG = ("step", "finite", "tells", "hear")  # what `together` stands for


def stepper(algorithm: Compensator, states: Sequence[Any]) -> Together:
    """What steps the legs: the algorithm's own `together`, but for a class that was derived from it and steps a leg otherwise."""
    kinds = type(algorithm).__mro__
    first = next((k for k, kind in enumerate(kinds) if "together" in vars(kind)), None)
    if first is None or any(name in vars(kind) for kind in kinds[:first] for name in OF_A_LEG):
        return OneByOne(algorithm, states)
    return algorithm.together(states)  # type: ignore[attr-defined]


def tell(algorithms: Sequence[Compensator], states: Sequence[Any], acted: np.ndarray, alike: np.ndarray) -> None:
    """Those that have something to tell, to all others that are alike. One algorithm a leg."""
    for i, state in enumerate(states):
        if acted[i] and algorithms[i].tells(state):
            for j, other in enumerate(states):
                if j != i and alike[i, j]:
                    algorithms[j].hear(other, state)
