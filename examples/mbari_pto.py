"""Another kind of machine: the power take-off of a wave buoy on a test machine (MBARI, four runs, US units, 50 Hz).

    python examples/mbari_pto.py [FOLDER]        default: shared/measured/mbari_pto beside the repository

A ram (area A) drives a fixed-displacement motor; gas springs above and below the piston. No valve: the plain balances
    flow    D omega = -A v                                          what the ram displaces goes through the motor
    force   F = A (P_l - P_u) + A_gl p_gl - A_gu p_gu - weight      on the rod
Motor speed and gas pressures come late, by another time in every run; they are aligned on the first half of each
quarter of a run and everything is scored on the second halves. A term is named only if every fold of the nested search
chooses it.

The alignment here is by correlation alone, and a delay takes what the oil's compressibility does. `hexsim trace
examples/own_machines/mbari_pto` fits delays and terms together, has a relief valve among the candidates, and names both.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from hexsim.errors import HexsimError
from hexsim.readers import read_log
from hexsim.signals.weak_form import Window
from hexsim.tracing.term_regression import OwnBalance, OwnVerdict, Point, Term, late_by, trace_own

HERE = Path(__file__).resolve().parent
DATA = HERE.parents[1] / "shared" / "measured" / "mbari_pto"
INCH = 0.0254
A = 1.375 * INCH**2  # [m2] ram, stated in the source of the data
D = 0.30 * INCH**3 / (2 * np.pi)  # [m3/rad] motor
A_GAS_LOWER = np.pi / 4 * (5.0 * INCH) ** 2  # [m2] gas piston, 5 inch bore
A_GAS_UPPER = A_GAS_LOWER - np.pi / 4 * (1.5 * INCH) ** 2  # less the 1.5 inch rod
WEIGHT_N = 48.0 * 9.81  # piston, mass stated in the source


def pressure(p: Point) -> np.ndarray:
    """Pressure across motor and ram [Pa]."""
    return p["pressure_lower_Pa"] - p["pressure_upper_Pa"]


def side(p: Point) -> np.ndarray:
    """sign(v), smooth within 5 mm/s."""
    return np.tanh(speed(p) / 5e-3)


def speed(p: Point) -> np.ndarray:
    """Velocity of the rod [m/s]."""
    return p["velocity_m_s"]


def one(p: Point) -> np.ndarray:
    return np.ones(len(p.log.time))


def gas(p: Point, name: str) -> np.ndarray:
    """A gas pressure, 0 where the spring was vented and the channel left out."""
    return p[name] if name in p.log.columns else np.zeros(len(p.log.time))


FLOW = OwnBalance(
    name="flow",
    unit="m3/s",
    target=lambda p: p.mean(D * p["motor_speed_rad_s"]),
    terms=(Term(name="ram area A", unit="m2", column=lambda p: -p.mean(speed(p)), declared=A, uncertainty=0.03 * A),),
    candidates=(
        Term(name="leakage", unit="m3/s/Pa", column=lambda p: -p.mean(pressure(p)), sign=-1),
        Term(name="compressibility V/E", unit="m3/Pa", column=lambda p: -p.rate(pressure(p)), sign=-1),
        Term(name="speed offset", unit="m3/s", column=lambda p: one(p)),
        Term(name="loss with direction", unit="m3/s", column=lambda p: -p.mean(side(p)), sign=-1),
        Term(
            name="turbulent leakage",
            unit="m3/s/Pa^0.5",
            sign=-1,
            column=lambda p: -p.mean(np.sign(pressure(p)) * np.sqrt(np.abs(pressure(p)))),
        ),
        Term(
            name="slip with speed and pressure", unit="m2/Pa", column=lambda p: -p.mean(np.abs(pressure(p)) * speed(p))
        ),
        Term(name="gain with position", unit="m", column=lambda p: -p.mean(speed(p) * (p["position_m"] - 1.0))),
    ),
)

FORCE = OwnBalance(
    name="force",
    unit="N",
    target=lambda p: p.mean(p["force_N"]),
    terms=(
        Term(name="ram area A", unit="m2", column=lambda p: p.mean(pressure(p)), declared=A, uncertainty=0.03 * A),
        Term(
            name="lower gas area",
            unit="m2",
            column=lambda p: p.mean(gas(p, "gas_lower_Pa")),
            declared=A_GAS_LOWER,
            uncertainty=0.03 * A_GAS_LOWER,
        ),
        Term(
            name="upper gas area",
            unit="m2",
            column=lambda p: -p.mean(gas(p, "gas_upper_Pa")),
            declared=A_GAS_UPPER,
            uncertainty=0.03 * A_GAS_UPPER,
        ),
        Term(
            name="weight and load cell zero",
            unit="N",
            column=lambda p: -one(p),
            declared=WEIGHT_N,
            uncertainty=WEIGHT_N,
        ),
    ),
    candidates=(
        Term(name="Coulomb friction", unit="N", column=lambda p: p.mean(side(p)), sign=1),
        Term(name="viscous friction", unit="N s/m", column=lambda p: p.mean(speed(p)), sign=1),
        Term(name="turbulent loss", unit="N s2/m2", column=lambda p: p.mean(speed(p) * np.abs(speed(p))), sign=1),
        Term(
            name="friction with hydraulic pressure",
            unit="m2",
            sign=1,
            column=lambda p: p.mean(np.abs(pressure(p)) * side(p)),
        ),
        Term(
            name="friction with gas pressure",
            unit="m2",
            sign=1,
            column=lambda p: p.mean((gas(p, "gas_lower_Pa") + gas(p, "gas_upper_Pa")) * side(p)),
        ),
        Term(
            name="Stribeck friction",
            unit="N",
            sign=1,
            column=lambda p: p.mean(side(p) * np.exp(-np.abs(speed(p)) / 0.03)),
        ),
        Term(name="spring", unit="N/m", column=lambda p: p.mean(p["position_m"] - 1.0)),
        Term(name="drift of the load cell", unit="N/s", column=lambda p: p.log.time - p.log.time[0]),
        Term(name="added mass", unit="kg", column=lambda p: p.rate(speed(p)), sign=1),
    ),
)


def aligned(path: Path) -> Point:
    """A run with its late channels moved: motor speed and gas against the ram's motion, force against oil."""
    log = read_log(path, HERE / "mbari_pto.toml")
    look = Window(log.rate, 0.15)
    v, oil = log.columns["velocity_m_s"], log.columns["pressure_lower_Pa"] - log.columns["pressure_upper_Pa"]
    shifts = {"motor_speed_rad_s": late_by(look, "motor speed", log.columns["motor_speed_rad_s"], v)}
    shifts["force_N"] = late_by(look, "force", look.rate(log.columns["force_N"]), look.rate(oil))
    for name in ("gas_lower_Pa", "gas_upper_Pa"):
        p = log.columns.get(name)
        if p is not None and np.ptp(p) > 2e4:  # vented: nothing to align
            shifts[name] = late_by(look, name, look.rate(np.log(p + 1.01325e5)), v)
    return Point(log=log, window=Window(log.rate, 0.2), shifts_s=shifts)


def trace(folder: Path) -> tuple[list[Point], list[OwnVerdict]]:
    """All runs of the folder, both balances."""
    if not folder.is_dir():
        raise HexsimError(f"the measured data are not in {folder}: give their folder")
    points = [aligned(path) for path in sorted(folder.glob("*.gz"))]
    return points, [trace_own(balance, points) for balance in (FLOW, FORCE)]


def print_verdict(console: Console, verdict: OwnVerdict) -> None:
    table = Table(title=f"{verdict.balance} balance, rest in {verdict.unit} on the run held out")
    for heading in ("held out", "declared", "refitted", "with terms", "terms chosen without it"):
        table.add_column(heading)
    for fold in verdict.folds:
        chosen = " + ".join(fold.chosen) or "none"
        table.add_row(fold.held_out, f"{fold.declared:.3g}", f"{fold.refit:.3g}", f"{fold.with_terms:.3g}", chosen)
    console.print(table)
    console.print(f"[bold]{verdict.verdict}[/bold]")
    declared = {term.name: term.declared for balance in (FLOW, FORCE) for term in balance.terms}
    for name, (value, error) in verdict.coefficients.items():
        shift = f"; declared {declared[name]:.4g}" if declared.get(name) is not None else ""
        console.print(f"  {name} = {value:.4g} +- {error:.2g} (spread over runs){shift}")


def main() -> None:
    console = Console()
    try:
        points, verdicts = trace(Path(sys.argv[1]) if len(sys.argv) > 1 else DATA)
    except HexsimError as error:
        console.print(str(error))
        sys.exit(2)
    for point in points:
        late = ", ".join(
            f"{name} {np.min(s) * 1e3:.0f} to {np.max(s) * 1e3:.0f} ms" for name, s in point.shifts_s.items()
        )
        console.print(f"{point.log.name}: {point.log.duration_s:.0f} s; late: {late}")
    for verdict in verdicts:
        print_verdict(console, verdict)


if __name__ == "__main__":
    main()
