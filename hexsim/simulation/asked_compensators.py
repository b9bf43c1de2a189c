"""Compensators that a host asks for by packets, collected until every leg has one."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

import compensation
from compensation import Compensator, Sample, preview_count
from compensation.started import Started
from hexsim.declaration import Machine
from hexsim.errors import HexsimError, shortened
from hexsim.hydraulics.resolve import resolve
from hexsim.motion_computer.compensator_packet import AskedCompensator
from hexsim.motion_computer.data_sheet import compensator_context
from hexsim.motion_computer.leg_load import ExpectedLoad


class AskedCompensators:
    """`take` each packet; it gives the compensators of all legs once the last has come, and `accept` says that they act.

    What acts already and is asked for again changes nothing: a host repeats itself while a machine compiles.
    """

    def __init__(self, machine: Machine) -> None:
        self.machine = machine
        self._asked: dict[int, AskedCompensator] = {}
        self._complete: dict[int, AskedCompensator] = {}
        self._acting: dict[int, AskedCompensator] = {}

    def accept(self) -> None:
        """What `take` gave last is in the loop."""
        self._acting = self._complete

    def take(self, asked: AskedCompensator, check: Callable[[], None] = lambda: None) -> list[Compensator] | None:
        """One a leg, none for plain control; None while legs are missing.

        check: called before anything is made, which takes longer than a tick; raises where now is not the time.
        Raises HexsimError for another number of legs, an unknown algorithm, or parameters that are not its own.
        """
        n = self.machine.n_legs
        if asked.n_legs != n:
            raise HexsimError(f"a compensator for {asked.n_legs} legs is asked for; {self.machine.name} has {n}")
        if asked.leg == 0:
            check()
            self._asked, self._complete = {}, {}
            return []
        self._asked[asked.leg] = asked
        if len(self._asked) < n:
            return None
        complete, self._asked = self._asked, {}
        if complete == self._acting:
            return None
        check()
        self._complete = complete
        return [self._started(self._complete[leg]) for leg in range(1, n + 1)]

    def _started(self, asked: AskedCompensator) -> Compensator:
        """A leg's algorithm, tried for one tick, which also compiles it."""
        try:
            made = Started(compensation.create_built_in(asked.name), asked.parameters)
            context = compensator_context(self.machine, None, asked.leg, ExpectedLoad.of(resolve(self.machine)))
            half, supply = 0.5 * context.stroke_m, context.supply_pressure_Pa
            made.step(
                made.start(context),
                Sample(
                    time_s=0.0,
                    setpoint_m=half,
                    preview_m=np.full(preview_count(made, context), half),
                    position_m=half,
                    control_V=0.0,
                    valve_V=0.0,
                    pressure_bottom_Pa=0.5 * supply,
                    pressure_supply_Pa=supply,
                ),
            )
        except Exception as error:  # parameters from outside may break an algorithm in any way; the machine goes on
            what = shortened(str(error).partition("\n")[0], 120)
            raise HexsimError(f"the compensator asked for leg {asked.leg} does not start: {what}") from None
        return made
