"""The machine as a linear system, for control design."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hexsim.declaration import Machine as DeclaredMachine
from hexsim.errors import HexsimError, one_of
from hexsim.face.given import is_number, load_machine, shown
from hexsim.face.show import Picture, chosen, html_table, picture_of
from hexsim.files.json_files import write_json
from hexsim.files.run_folder import default_folder, run_folder
from hexsim.mechanics.mechanics import DOF_NAMES
from hexsim.motion_computer.linear_plant import LinearPlant, linear_plant
from hexsim.recording.quantity import split_key
from hexsim.recording.summary_table import number

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class LinearModel(LinearPlant):
    """x' = A x + B u, y = C x + D u about an operating point; every number is a deviation from it.

    A (n, n), B (n, legs), C (outputs, n), D (outputs, legs), SI units. states, inputs, outputs: names as in the log, with
    the unit at their end: "pressure_bottom_1_Pa", "valve_1_V".
    """

    machine: str

    @property
    def units(self) -> dict[str, str]:
        """Name of a state, an input or an output -> its unit."""
        return {name: split_key(name)[1] for name in (*self.states, *self.inputs, *self.outputs)}

    @property
    def poles(self) -> NDArray[np.complex128]:
        """Eigenvalues of A (n,) [1/s]."""
        return np.linalg.eigvals(self.A).astype(np.complex128)

    def to_control(self) -> Any:
        """The same as `control.ss` with its names. Raises HexsimError where python-control is not installed."""
        try:
            import control
        except ImportError:
            raise HexsimError(
                "to_control needs python-control: install it with `pip install hexsim[control]`"
            ) from None
        return control.ss(
            self.A,
            self.B,
            self.C,
            self.D,
            states=list(self.states),
            inputs=list(self.inputs),
            outputs=list(self.outputs),
            name=self.machine,
        )

    def modes(self) -> list[tuple[float, float]]:
        """(frequency [Hz], damping ratio) of each oscillating pair of poles, the slowest first."""
        pairs = self.poles[self.poles.imag > 0]
        return sorted((float(abs(pole)) / (2 * np.pi), float(-pole.real / abs(pole))) for pole in pairs)

    def response(self, frequency_Hz: Sequence[float] | Array) -> NDArray[np.complex128]:
        """Outputs for a sine on each input (n, outputs, inputs), complex, at frequencies (n,) [Hz]: C (jw - A)^-1 B + D."""
        w = 2.0 * np.pi * np.asarray(frequency_Hz, dtype=np.float64)
        inside = 1j * w[:, None, None] * np.eye(len(self.A)) - self.A
        return (self.C @ np.linalg.solve(inside, np.broadcast_to(self.B, (len(w), *self.B.shape))) + self.D).astype(
            np.complex128
        )

    def plot(self, output: str | None = None) -> Picture:
        """Gain and phase of an output for volts on all valves together, 0.1 Hz to 1 kHz; None: acceleration in heave or of the
        leg. Raises HexsimError for an unknown output."""
        default = next(name for name in ("acceleration_z_m_s2", "acceleration_m_s2") if name in self.outputs)
        there = {name: lambda name=name: self._bode(name) for name in self.outputs}
        return picture_of(chosen(output or default, there), output or default)

    def _bode(self, output: str) -> Figure:
        from hexsim.recording.figure_style import TIGHT, plain_frequencies, plain_powers, small_multiples, styled

        @styled
        def drawn() -> Figure:
            frequency = np.logspace(-1.0, 3.0, 2000)
            along = self.response(frequency)[:, self.outputs.index(output)].sum(axis=1)
            figure, (gain, phase) = small_multiples(
                2, f"{self.machine}: {output} for volts on all valves", 1, 2.4, True, TIGHT
            )
            gain.loglog(frequency, np.abs(along))
            gain.set_ylabel(f"gain [{split_key(output)[1]} a volt]")
            phase.semilogx(frequency, np.degrees(np.unwrap(np.angle(along))))
            phase.set(ylabel="phase [deg]", xlabel="frequency [Hz]")
            plain_frequencies(phase)
            plain_powers(gain)
            return figure

        return drawn()

    def to_folder(self, path: str | Path | None = None) -> Path:
        """Write linear.json (matrices, names, units) and response.png; the folder. path: None: `runs/<time>-linear-<machine>`."""
        with run_folder(default_folder(f"linear-{self.machine}") if path is None else Path(path)) as folder:
            names = {what: list(getattr(self, what)) for what in ("states", "inputs", "outputs")}
            matrices = {what: getattr(self, what).tolist() for what in "ABCD"}
            write_json(folder.path / "linear.json", {"machine": self.machine, **names, "units": self.units, **matrices})
            self.plot().save(folder.path / "response.png")
            return folder.finish()

    def __repr__(self) -> str:
        return f"<LinearModel of {self.machine}: {len(self.A)} states, {len(self.inputs)} inputs, {len(self.outputs)} outputs>"

    def _repr_html_(self) -> str:
        rows = [(number(frequency), number(damping)) for frequency, damping in self.modes()]
        names = [f"{what}: {', '.join(getattr(self, what))}" for what in ("states", "inputs", "outputs")]
        return html_table(("mode [Hz]", "damping ratio"), rows, repr(self)[1:-1], names)


def linearize(
    machine: str | Path | DeclaredMachine,
    at: Mapping[str, float] | Sequence[float] | Array | None = None,
    *,
    extends: bool = True,
) -> LinearModel:
    """The plant as a linear model: valve volts in; pistons, chambers and the platform's pose and acceleration out.

    at: pose from neutral, {"z": 0.02, "roll": 0.05} or six numbers [m, rad]; of a bench {"z": 0.05} moves the piston.
    extends: the valves stand open by 1 % of their travel beyond the lap in the sense that extends the legs, or retracts
    them: a shut valve with overlap has no gain at all. Left out: dry friction, delay and hysteresis of the valve, supply
    dynamics, payloads on springs (held), sensors and controller.
    Raises HexsimError for a pose out of reach or an axis that the machine has not.

    >>> model = hx.linearize("bench")
    >>> model.inputs, model.outputs
    (('valve_V',), ('position_m', 'pressure_bottom_Pa', 'acceleration_m_s2'))
    >>> model.units["pressure_bottom_Pa"], model.A.shape
    ('Pa', (5, 5))
    """
    made = load_machine(machine)
    return LinearModel(machine=made.name, **vars(linear_plant(made, _pose(made, at), extends)))


def _pose(machine: DeclaredMachine, at: Any) -> Array:
    """Six numbers from neutral."""
    pose, mechanics = np.zeros(6), machine.mechanics
    if at is None:
        return pose
    if isinstance(at, Mapping):
        for axis, value in at.items():
            if axis not in mechanics.dofs:
                raise HexsimError(f"at: {machine.name} has no axis {shown(axis)}: {one_of(str(axis), mechanics.dofs)}")
            if not is_number(value) or not np.isfinite(value):
                raise HexsimError(f"at: {axis} is {shown(value)}: give a number in m, of rotations in rad")
            pose[DOF_NAMES.index(axis)] = value
        return pose
    try:
        given = np.asarray(at, dtype=np.float64)
    except (TypeError, ValueError):
        given = np.zeros(0)
    if given.shape != (6,) or not np.isfinite(given).all():
        raise HexsimError(f"at is {shown(at)}: give {{'z': 0.02}}, or six finite numbers x .. yaw [m, rad]")
    return given
