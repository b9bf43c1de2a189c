"""A scenario driven by a host that knows no future: its packets, with jitter and loss, through the motion computer's buffer."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hexsim.declaration import Machine
from hexsim.errors import HexsimError
from hexsim.motion_computer.host_packet import HostCommand
from hexsim.motion_computer.host_setpoints import HostSetpoints
from hexsim.scenarios import Scenario
from hexsim.scenarios.bench_motion import bench_motion

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Host:
    """rate_Hz: packets a second. jitter: standard deviation of how late one comes, in periods. loss: share that never
    comes. buffer_s: latency given away; None: the machine's. seed: of jitter and loss. derivatives: packets carry the
    setpoints' velocities and accelerations, too."""

    rate_Hz: float = 500.0
    jitter: float = 0.0
    loss: float = 0.0
    buffer_s: float | None = None
    seed: int = 0
    derivatives: bool = False

    def __post_init__(self) -> None:
        for name, least, most in (
            ("rate_Hz", 10.0, 2000.0),
            ("jitter", 0.0, 5.0),
            ("loss", 0.0, 0.9),
            ("buffer_s", 0.0, 0.5),
        ):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and least <= value <= most):
                raise HexsimError(f"host: {name} is {value}; give a number from {least:g} to {most:g}")

    @classmethod
    def parse(cls, text: str) -> Host:
        """Of RATE[,jitter=SHARE][,loss=SHARE][,buffer=SECONDS][,seed=N][,derivatives], as the command line gives it."""
        rate, *rest = text.split(",")
        try:
            pairs = dict(pair.split("=") for pair in rest if pair != "derivatives")
            seed = int(pairs.pop("seed", 0))
            numbers = {key: float(value) for key, value in pairs.items()}
            if "buffer" in numbers:
                numbers["buffer_s"] = numbers.pop("buffer")
            return cls(rate_Hz=float(rate), seed=seed, derivatives="derivatives" in rest, **numbers)
        except (ValueError, TypeError):
            raise HexsimError(
                f"host {text!r} is none: give its packets a second, and what else it has: 60,jitter=0.2,loss=0.02,buffer=0.02"
            ) from None

    def packets(
        self, motion: Callable[[Array], Array], duration_s: float, mode: int
    ) -> Iterator[tuple[float, HostCommand]]:
        """(arrival [s], packet) in the order of arrival, of a motion's setpoints (n, 6) at times (n,)."""
        draw = np.random.default_rng(self.seed)
        sent = np.arange(math.ceil(duration_s * self.rate_Hz) + 1) / self.rate_Hz
        setpoints = motion(sent)
        changes = _derivatives(motion, sent) if self.derivatives else None
        late = np.abs(draw.normal(0.0, 1.0, len(sent))) * self.jitter / self.rate_Hz
        arrives, comes = sent + late, draw.random(len(sent)) >= self.loss
        for k in np.argsort(arrives, kind="stable"):
            if comes[k]:
                command = HostCommand(
                    sequence=int(k),
                    time_s=float(sent[k]),
                    setpoints=tuple(setpoints[k].tolist()),
                    mode=mode,
                    derivatives=None
                    if changes is None
                    else (tuple(changes[0][k].tolist()), tuple(changes[1][k].tolist())),
                )
                yield float(arrives[k]), command


def _derivatives(
    motion: Callable[[Array], Array],
    time: Array,
    *,
    step_s: float = 1e-3,  # of the differences that stand for the derivatives a host knows
) -> tuple[Array, Array]:
    """First and second derivative (n, 6) of a motion that begins at rest."""
    before, here, after = (motion(np.maximum(time + k * step_s, 0.0)) for k in (-1, 0, 1))
    return (after - before) / (2.0 * step_s), (after - 2.0 * here + before) / step_s**2


def hosted_setpoints(machine: Machine, scenario: Scenario, host: Host, ticks: int, preview: int) -> Array:
    """Piston setpoints (ticks + preview, n_legs) that the motion computer makes of a scenario's packets."""
    mode = int(scenario.mode == "actuator")

    def motion(time: Array) -> Array:
        if machine.mechanics.has_platform:
            return scenario.evaluate(time)[0]
        values = np.zeros((len(time), 6))
        values[:, 0 if mode else 2] = bench_motion(scenario, time)[0]
        return values

    return played(machine, motion, host, ticks, preview, mode)


def played(
    machine: Machine, motion: Callable[[Array], Array], host: Host, ticks: int, preview: int, mode: int = 0
) -> Array:
    """Piston setpoints (ticks + preview, n_legs), tick by tick, of a host whose setpoints (n, 6) at times (n,) are `motion`.

    The first `preview` - 1 are at neutral. Nothing here depends on what the machine does.
    """
    tick_s, made = 1.0 / machine.controller.rate_Hz, HostSetpoints(machine, preview, buffer_s=host.buffer_s)
    made.start(mode)
    waiting = host.packets(motion, ticks * tick_s, mode)
    packet = next(waiting, None)
    out = np.empty((ticks + preview, machine.n_legs))
    for k in range(ticks):
        while packet is not None and packet[0] <= k * tick_s:
            made.buffer.add(packet[1], k * tick_s)
            packet = next(waiting, None)
        out[k : k + preview] = made.rows(k * tick_s)
    out[-1] = out[-2]
    return out
