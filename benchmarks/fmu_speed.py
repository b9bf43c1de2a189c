"""How fast an exported FMU runs: simulated over processor time, FMPy calling it every 2 ms. `python benchmarks/fmu_speed.py`"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

import fmpy
import numpy as np
from fmpy.fmi2 import FMU2Slave

from hexsim.export import export_fmu
from hexsim.machine import load_machine
from hexsim.plant import Plant

STEP_s, DURATION_s = 0.002, 1.0
CASES = (("bench", "full"), ("micro_motion_system", "tendon"), ("micro_motion_system", "full"))


def fmu_ratio(path: Path, volts: np.ndarray) -> float:
    """Of one run under `volts` (steps, n_legs), all outputs read at each step."""
    with tempfile.TemporaryDirectory() as folder:
        fmpy.extract(str(path), unzipdir=folder)
        description = fmpy.read_model_description(folder)
        outputs = [v.valueReference for v in description.modelVariables if v.causality == "output"]
        inputs = list(range(volts.shape[1]))
        slave = FMU2Slave(
            guid=description.guid,
            unzipDirectory=folder,
            instanceName="speed",
            modelIdentifier=description.coSimulation.modelIdentifier,
        )
        slave.instantiate()
        slave.setupExperiment()
        slave.enterInitializationMode()
        slave.exitInitializationMode()
        begun = time.process_time()
        for k, command in enumerate(volts.tolist()):
            slave.setReal(inputs, command)
            slave.doStep(k * STEP_s, STEP_s)
            slave.getReal(outputs)
        used = time.process_time() - begun
        slave.terminate()
        slave.freeInstance()
    return len(volts) * STEP_s / used


def plant_ratio(plant: Plant, volts: np.ndarray) -> float:
    """Of `Plant` under the same volts."""
    plant.prepare(1 / STEP_s)
    plant.tick(volts[0])
    begun = time.process_time()
    for command in volts:
        plant.tick(command)
    return len(volts) * STEP_s / (time.process_time() - begun)


def main() -> None:
    """A line for each machine."""
    with tempfile.TemporaryDirectory() as folder:
        for name, model in CASES:
            machine, path = load_machine(name), Path(folder) / f"{name}_{model}.fmu"
            export_fmu(machine, path, model=model)
            t = np.arange(0, DURATION_s, STEP_s)[:, None]
            volts = 0.5 * np.sin(2 * np.pi * (1 + 0.2 * np.arange(machine.n_legs)) * t)
            ratios = fmu_ratio(path, volts), plant_ratio(Plant(machine, model=model), volts)
            size = path.stat().st_size / 1e6
            print(f"{name} ({model}): FMU {ratios[0]:.1f} times real time, Plant {ratios[1]:.1f}; {size:.1f} MB")


if __name__ == "__main__":
    main()
