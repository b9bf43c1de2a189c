"""The machine behind the page while a simulator flies: the server of `hexsim serve --from`, and what was flown and felt.

flown    the vehicle's acceleration and rates, as its packets say
asked    the same after dead band, lag, gain and the washout's scale, faded in and out with the packets
felt     specific force less gravity at rest, of the platform: R^T (a + g e_z) - g e_z; and its turning, in its own axes
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hexsim.cueing.protocols import VehicleMotion
from hexsim.cueing.shaping import AXES, AxisShape
from hexsim.cueing.washout import Washout, g
from hexsim.errors import HexsimError
from hexsim.machine import Machine
from hexsim.motion_computer.states import State
from hexsim.packets import HOST_PORT
from hexsim.plant.plant import PlantError
from hexsim.simulation.live import add_floor_and_light
from hexsim.simulation.serve import HostInput, Server
from hexsim.simulation.serve_status import Status
from hexsim.simulation.stream import Stream
from hexsim.simulation.vehicle_link import SILENT_S, Vehicle, VehicleLink
from hexsim.web.session import FRAME_S, STOP_S

Array = NDArray[np.float64]
GRAVITY = np.array([0.0, 0.0, g])
SHOWN_S = 10.0  # of flown and felt


@dataclass(frozen=True, kw_only=True, eq=False)
class FlightShown:
    """What the page shows. time_s (n,) [s], up to 0 now; flown, asked, felt (n, 6) [m/s2, rad/s] in the order of AXES."""

    time_s: Array
    flown: Array
    asked: Array
    felt: Array
    state: str
    packets: str
    messages: tuple[str, ...] = ()
    behind_s: float = 0.0
    error: str = ""


class FlownServer(Server):
    """Calls `after_tick` behind every tick."""

    after_tick: Callable[[], None] = staticmethod(lambda: None)

    def tick(self) -> None:
        super().tick()
        self.after_tick()


@dataclass(kw_only=True)
class _Rows:
    """Means over `ticks` ticks, the last `n` of them."""

    ticks: int
    n: int
    sums: Array = field(init=False)
    kept: Array = field(init=False)
    count: int = 0

    def __post_init__(self) -> None:
        self.sums, self.kept = np.zeros(3 * len(AXES)), np.zeros((self.n, 3 * len(AXES)))

    def add(self, row: Array) -> None:
        self.sums += row
        self.count += 1
        if self.count == self.ticks:
            self.kept = np.vstack((self.kept[1:], self.sums / self.ticks))
            self.sums, self.count = np.zeros_like(self.sums), 0


class Flight:
    """A machine that a simulator drives, in real time until `stop`. address: where its packets are listened for.

    Raises HexsimError where the address cannot be had or the machine cannot run.
    """

    def __init__(
        self,
        machine: Machine,
        vehicle: Vehicle,
        washout: Washout | None = None,
        compensator: str = "none",
        host: str = "127.0.0.1",
        port: int = HOST_PORT,
        stream: Stream | None = None,
        *,
        row_s: float = 0.02,  # between its rows, each a mean
    ) -> None:
        if not machine.mechanics.has_platform:
            raise HexsimError(f"machine {machine.name} has no platform: a simulator drives hexapods")
        self.washout, self.vehicle = washout or Washout(), vehicle
        self.server = FlownServer(
            machine,
            host,
            port,
            compensator=compensator,
            host_input=HostInput(vehicle=vehicle, washout=self.washout),
            furnish=lambda spec: add_floor_and_light(spec, machine),
            stream=stream,
        )
        assert isinstance(self.server.link, VehicleLink)
        self.link: VehicleLink = self.server.link
        self.address = self.server.address
        data = self.server.plant.data
        self._turn = data.body(self.server.kinematics.moving_body).xmat  # a view
        self._place = int(self.server.plant.model.joint("platform_free").dofadr[0])
        ticks = max(1, round(row_s / self.server.tick_s))
        self._rows = _Rows(ticks=ticks, n=round(SHOWN_S / (ticks * self.server.tick_s)))
        self._status, self._error = Status(), ""
        self._on_frame: Callable[[Any], None] = lambda simulated: None
        self._next_frame = 0.0
        self._reset_asked = False
        self._stop = threading.Event()
        self._thread: threading.Thread | None = None
        self.server.after_tick = self._after_tick

    @property
    def model(self) -> Any:
        return self.server.plant.model

    def ask(self, shapes: Mapping[str, AxisShape]) -> None:
        """Other gains, lags and dead bands, by axis."""
        self.link.cueing.shaping.ask(shapes)

    def reset(self) -> None:
        """After a fault: reset and start, as soon as the platform is at rest."""
        self._reset_asked = True

    def start(self, on_frame: Callable[[Any], None] = lambda simulated: None) -> None:
        """Simulate from now on. on_frame: 30 times a second, with the plant."""
        self._on_frame = on_frame
        self._thread = threading.Thread(target=self._run, name="simulation", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """End the simulation and give the address back."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join(timeout=STOP_S)
        self.link.close()

    def new_warnings(self) -> list[str]:
        """Since the last call; after `stop` those that were still open."""
        return self.server.cavitation.unsaid()

    def _run(self) -> None:
        try:
            self.server.run(stop=self._stop, report=self._note)
        except PlantError as error:
            self._error = f"The simulation diverged ({error}). Begin again."

    def _note(self, status: Status) -> None:
        self._status = status

    def _after_tick(self) -> None:
        """In the thread that simulates."""
        motion, data = self.link.motion, self.server.plant.data
        flies = isinstance(motion, VehicleMotion)
        flown = np.array([*motion.acceleration, *motion.rates]) if flies else np.zeros(6)
        flown *= self.link.silent_s <= SILENT_S
        turn = self._turn.reshape(3, 3)
        place = self._place
        felt = turn.T @ (data.qacc[place : place + 3] + GRAVITY) - GRAVITY
        asked = self.link.cueing.asked * flies
        self._rows.add(np.concatenate((flown, asked, felt, data.qvel[place + 3 : place + 6])))
        if self._reset_asked:
            self._go_on()
        now = time.monotonic()
        if now >= self._next_frame:
            self._next_frame = now + FRAME_S
            self._on_frame(self.server.plant)

    def _go_on(self) -> None:
        computer, now_s = self.server.computer, self.server.time_s
        if computer.state == State.FAULT and computer.arrived:
            computer.command("reset", now_s)
        if computer.state == State.OFF:
            computer.command("start", now_s)
        self._reset_asked = computer.state in (State.FAULT, State.SETTLING)

    def shown(self) -> FlightShown:
        """What is to be shown now."""
        kept, status = self._rows.kept, self._status
        flown, asked, felt = np.split(kept, 3, axis=1)
        time_s = np.arange(1 - len(kept), 1, dtype=np.float64) * (self._rows.ticks * self.server.tick_s)
        return FlightShown(
            time_s=time_s,
            flown=flown,
            asked=asked,
            felt=felt,
            state=self._state(),
            packets=self._packets(),
            messages=tuple(text for _, _, text in list(self.server.messages)[-3:]),
            behind_s=status.behind_s,
            error=self._error,
        )

    def _state(self) -> str:
        errors = self._status.errors
        name = self.server.computer.state.name.lower()
        return f"{name}: {', '.join(errors)}" if errors and name == "fault" else name

    def _packets(self) -> str:
        """One sentence: what came, what was understood, and whether it is waited for more."""
        received, refused = self.link.counts["received"], self.link.counts["malformed"]
        if not received:
            return f"none of {self.vehicle.name} yet on {self.address[0]}:{self.address[1]}"
        line = (
            self.link.refusals.line(received, self.vehicle.name) if refused else f"{received} packets, all understood"
        )
        silent = self.link.silent_s
        return f"{line}; silent for {silent:.1f} s, waits for them" if SILENT_S < silent < np.inf else line
