"""A motion as the motion computer plays it from a host's packets, which tell no future."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.grid.motions import MIDDLE_m, Motion


def played_setpoints(host: str, motion: Motion, seed: int, ticks: int, look: int) -> np.ndarray:
    """(ticks + look,) setpoints [m] of a bench. host: as `hexsim run --host` takes it, with the seed's jitter and losses."""
    from hexsim.machine import load_machine
    from hexsim.simulation.hosted import Host, played

    def pose(time: np.ndarray) -> np.ndarray:
        return np.outer(motion.path(time) - MIDDLE_m, np.eye(6)[2])

    asked = replace(Host.parse(host), seed=seed)
    return played(load_machine("bench"), pose, asked, ticks, look)[:, 0]
