"""What a run was made of and what it gave, as plain tables: config.toml and summary.json."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING, Any

from hexsim import __version__
from hexsim.files.json_files import plain
from hexsim.machine.files import machine_tables

if TYPE_CHECKING:
    from hexsim.simulation import Run

VERSIONS_OF = ("mujoco", "numpy", "scipy", "numba", "polars")


def summary_of(run: Run) -> dict[str, Any]:
    """summary.json; an interrupted or diverged run says so."""
    if run.complete:
        return run.summary
    return {**run.summary, "partial": True, "reason": run.reason}


def config_tables(run: Run) -> dict[str, Any]:
    """All that was resolved: with it the run can be repeated to the bit on the same versions."""
    return plain(
        {
            "run": {
                "scenario": run.scenario.name,
                "machine": run.machine.name,
                "compensator": run.compensator,
                "seed": run.seed,
                "model": run.model,
                "scheme": "rk4",
                "timestep_s": run.timestep if run.timestep is not None else "chosen",
                "complete": run.complete,
                "reason": run.reason,
            },
            "versions": {"hexsim": __version__, "python": platform.python_version(), **_versions()},
            "scenario": run.scenario.to_dict(),
            "machine": machine_tables(run.machine),
        }
    )


def _versions() -> dict[str, str]:
    found = {}
    for name in VERSIONS_OF:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found
