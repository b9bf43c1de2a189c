"""An effect: a named extension of one balance, with parameters that have a unit, bounds, a source and a neutral value.

The plant can switch it on, a fault scenario can use it, tracing can screen it, and a machine file can carry it:

    [effects.leakage_supply_to_chamber]
    conductance_m3_s_Pa = 2.4e-12
    where = "leg 2"                      # or "all legs" (default), ["leg 1", "leg 4"], "platform"

An effect is one file of this folder that defines EFFECT. Most add to places of the leg's row (`slot`); an effect on
the load, the sensors or the supply gives its own `apply`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from hexsim.declaration import Machine
from hexsim.hydraulics.parameters import P
from hexsim.hydraulics.resolved import Resolved

Balance = Literal["valve", "supply", "continuity", "force", "sensor", "platform", "controller"]


@dataclass(frozen=True, kw_only=True)
class EffectParameter:
    """One number of an effect. `neutral` is where the effect vanishes, `typical` a typical strength in SI.

    neutral = math.inf: the effect vanishes as the number grows (a frequency, a stiffness); tracing works on 1/value.
    grid: values to screen when the number shapes the effect and does not scale it (a wavelength, a phase).
    power: of the number to which a small effect grows; tracing works on number^power, in which it is linear.
    step_share: of the usual finite difference: a wave of many periods is not linear in its length.
    kinds: machine kinds on which it means something; tracing looks for it there.
    of_the_file: says what the machine file means and nothing of the machine: nobody asks how well it is known.
    adds_to: keys of the machine file to whose values it adds, in the same unit: logs show the sum.
    """

    name: str  # with its unit
    unit: str
    bounds: tuple[float, float]
    typical: float
    neutral: float = 0.0
    slot: P | None = None  # place of the leg's row that the value is added to
    default: float | None = None  # when the file may leave it out
    grid: tuple[float, ...] = ()
    power: float = 1.0
    step_share: float = 1.0
    kinds: tuple[str, ...] = ("bench", "hexapod")
    of_the_file: bool = False
    adds_to: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Effect:
    """A named extension of one balance.

    places: where it can act ("leg": one leg or all; "one leg": alike in all it does nothing;
         "platform"; "machine": shared by all, such as the supply).
    kinds: machine kinds that can have it.  four_way: whether only machines whose rod side is on the valve have it.
    built_in: stands in how the machine is built, so that it cannot begin in a run.
    shown_by: the input that would show an effect that slow motion does not show.
    generic: stands for any cause of its form; of a tie, the other is named.
    vector: its numbers are components of one thing: any of them may be the one that is there.
    term: what it adds to its balance, where another effect adds the same: no log takes two such effects apart.
    limit: its size acts only where motion reaches it, and its other numbers act without.
    second_order_lag: its numbers are frequency and damping of a second-order lag.
    once: its numbers describe one thing that a leg (or the machine) has once; of other effects, two tables on a leg add up.
    nonlinear_response: a softer chamber moves the oil's resonance, so that the answer is far from proportional to its size.
    """

    name: str
    balance: Balance
    description: str
    source: str
    parameters: tuple[EffectParameter, ...]
    apply: Callable[[Resolved, tuple[int, ...], dict[str, float]], None] | None = None
    places: Literal["leg", "one leg", "platform", "machine"] = "leg"
    kinds: tuple[str, ...] = ("bench", "hexapod")
    four_way: bool = False
    built_in: bool = False
    shown_by: str = ""
    generic: bool = False
    vector: bool = False
    term: str = ""
    limit: bool = False
    second_order_lag: bool = False
    once: bool = False
    nonlinear_response: bool = False

    def fits(self, machine: Machine) -> bool:
        """Can this machine have it?"""
        of_valve = machine.cylinder.rod_side == "valve"
        return machine.machine.kind in self.kinds and (of_valve or not self.four_way)

    def add_to(self, resolved: Resolved, legs: tuple[int, ...], values: dict[str, float]) -> None:
        """Switch the effect on in `legs` (0-based): by its own `apply`, or value by value into the slots."""
        if self.apply is not None:
            self.apply(resolved, legs, values)
            return
        for parameter in self.parameters:
            if parameter.slot is not None:
                resolved.rows[list(legs), parameter.slot] += values[parameter.name] - parameter.neutral
