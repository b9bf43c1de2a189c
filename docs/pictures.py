"""Every picture of the site and of the README, drawn anew from runs that are made here.

    python docs/pictures.py [--out docs/images] [--only heave --only trace ...]

A group makes the pictures that share a run. MuJoCo draws without a screen by `MUJOCO_GL=egl` or `osmesa`.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path

from hexsim.machine import load_machine
from hexsim.machine.files import models_folder
from hexsim.recording.figure_style import png
from hexsim.recording.figures import comparison, run_figures
from hexsim.recording.signals import Signals
from hexsim.scenarios import load_scenario
from hexsim.studies.compare import compare
from hexsim.tracing.signature import picture, signature

ROOT = Path(__file__).parents[1]
DPI = 120  # of figures whose size this script chooses
SIZE = (760, 1000)  # rows and columns of a picture of a machine
EFFECTS = (
    "leakage_supply_to_chamber",
    "overlap_change",
    "supply_droop",
    "valve_hysteresis",
    "flexible_payload",
    "presliding",
)

Pictures = Mapping[str, bytes]


def heave() -> Pictures:
    """The standard heave of the 600 kg machine, without and with compensation."""
    runs = compare(load_machine("micro_motion_system"), load_scenario("heave"), ["none", "adaptive"], fast=True)
    signals = {name: Signals.of_run(run, name) for name, run in runs.items()}
    drawn = {f"heave_{name}": figure for name, figure in run_figures(signals["none"]).items() if name != "motion"}
    peaks = {name: run.summary["axes"]["z"]["peak_band_m_s2"] for name, run in runs.items()}
    side_by_side = comparison(signals, "z", peaks)
    assert side_by_side is not None
    return {name: png(figure, DPI) for name, figure in (drawn | {"compare_heave": side_by_side}).items()}


def trace() -> Pictures:
    """The bench with a leak that its machine file does not have."""
    from hexsim.tracing.report import balance_figure, budget, figures
    from hexsim.tracing.trace import trace as run

    result = run(ROOT / "tests" / "data" / "bench_leakage", ["fit", "sweep"], ["validate"])
    return {
        "trace_budget": budget.waterfall(result),
        "trace_comparison": figures.comparison(result, figures.answers_of(result)),
        "trace_balances": balance_figure.balances(result),
        "trace_parameters": figures.parameters(result),
    }


def effects() -> Pictures:
    """What an effect looks like in the balance that it violates most."""
    return {f"signature_{name}": png(picture(signature(name)), DPI) for name in EFFECTS}


def valve() -> Pictures:
    """The servo valve of `servo_bench` as ISO 10770 would test it."""
    from hexsim.studies.valve_report import dynamic_figure, static_figure
    from hexsim.studies.valve_test import valve_test

    test = valve_test(load_machine("servo_bench"))
    return {"valve_static": png(static_figure(test), DPI), "valve_dynamic": png(dynamic_figure(test), DPI)}


def qualify() -> Pictures:
    """Motion tests of the bench."""
    from hexsim.qualification import QUICK, Battery, MachineRig
    from hexsim.qualification.plots import pictures

    drawn = pictures(Battery(MachineRig(load_machine("bench")), QUICK).run().curves)
    return {f"qualify_{name.replace(' ', '_').replace('-', '_')}": data for name, data in drawn.items()}


def chapter4() -> Pictures:
    """Simulation and reality, as chapter 4 of the report has it."""
    sys.path.insert(0, str(ROOT / "examples"))
    from report_chapter4 import main as draw

    with tempfile.TemporaryDirectory() as folder:
        draw(Path(folder))
        return {f"chapter4_{name}": (Path(folder) / f"{name}.png").read_bytes() for name in ("supply", "flow_curve")}


def temperature() -> Pictures:
    """A leg whose oil warms, and the law of its valve's edges."""
    sys.path.insert(0, str(ROOT / "examples"))
    import warm_up

    return {"warm_up": png(warm_up.ride_figure(warm_up.ride()), DPI), "laminar_edge": png(warm_up.edge_figure(), DPI)}


def results() -> Pictures:
    """Pictures of results that are kept, from their figures."""
    sys.path.insert(0, str(ROOT / "benchmarks"))
    import host_path
    import reversal_limit

    drawn = {}
    with tempfile.TemporaryDirectory() as folder:
        for made in (host_path, reversal_limit):
            place = Path(folder) / f"{made.__name__}.png"
            made.picture(json.loads(made.RESULT.read_text(encoding="utf-8")), place)
            drawn[made.__name__] = place.read_bytes()
    return drawn


def learning() -> Pictures:
    """The kept policy of examples/learned_policy.py."""
    sys.path.insert(0, str(ROOT / "examples"))
    import learned_policy

    return {"learned_policy": learned_policy.picture(json.loads(learned_policy.KEPT.read_text(encoding="utf-8")))}


def cueing() -> Pictures:
    """A car's manoeuvre through a host's packets, as felt; and what washouts make of a push."""
    import runpy
    from unittest.mock import patch

    from washout_figure import washout_figure

    from hexsim.cueing.washout import Washout

    washouts = {
        "surge from 2.5 rad/s on": Washout(),
        "surge from 1.2 rad/s on": Washout(high_pass_rad_s=(1.2, 1.2, 4.0)),
        "from 1.2 rad/s on, adaptive": Washout(high_pass_rad_s=(1.2, 1.2, 4.0), adaptive=True),
    }
    drawn = {"washout": png(washout_figure(washouts, 3.0), DPI)}
    with tempfile.TemporaryDirectory() as folder:
        arguments = "--fast --compensator adaptive --tune --host 60,jitter=0.2,loss=0.02,derivatives --out"
        with patch.object(sys, "argv", ["motion_cueing.py", *arguments.split(), folder]):
            runpy.run_path(str(ROOT / "examples" / "motion_cueing.py"), run_name="__main__")
        return drawn | {"cueing_host": (Path(folder) / "cueing.png").read_bytes()}


def story() -> Pictures:
    """A hexapod of which one leg leaks, identified behind its packets; the longest of all: some ten minutes."""
    sys.path.insert(0, str(ROOT / "examples"))
    from close_the_loop import close_the_loop

    with tempfile.TemporaryDirectory() as folder:
        close_the_loop("micro_motion_system", 5.0, Path(folder)).to_folder()
        return {"story": (Path(folder) / "story.png").read_bytes()}


def machines() -> Pictures:
    """The machines that travel with hexsim, in their home position."""
    return {name: rendered(name) for name in ("bench", "micro_motion_system", "servo_bench", "servo_hexapod")}


def rendered(name: str) -> bytes:
    """A machine as MuJoCo shows it from its front camera, as PNG."""
    from io import BytesIO

    import matplotlib.image
    import mujoco

    model = mujoco.MjModel.from_xml_path(str(models_folder() / name / "scene.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    with mujoco.Renderer(model, *SIZE) as renderer:
        renderer.update_scene(data, camera="front")
        buffer = BytesIO()
        matplotlib.image.imsave(buffer, renderer.render(), format="png")
    return buffer.getvalue()


def live_web() -> Pictures:
    """The page of `hexsim live --web`, after the slider of the overlap went from 5 to 20 um."""
    from hexsim.demo.live_act import page_picture

    name = "micro_motion_system"
    return {"live_web": page_picture(load_machine(name), name, load_scenario("heave"))}


GROUPS: dict[str, Callable[[], Pictures]] = {
    f.__name__: f
    for f in (
        heave,
        trace,
        effects,
        valve,
        qualify,
        chapter4,
        temperature,
        results,
        learning,
        cueing,
        story,
        machines,
        live_web,
    )
}


def main(out: Path, only: list[str]) -> list[Path]:
    """Write the pictures of the groups; returns their paths."""
    out.mkdir(parents=True, exist_ok=True)
    written = []
    for name in only or GROUPS:
        for picture_name, data in GROUPS[name]().items():
            written.append(out / f"{picture_name}.png")
            written[-1].write_bytes(data)
            print(written[-1])
    return written


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Draw the pictures of the site and of the README.")
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "images", help="folder to write")
    parser.add_argument("--only", action="append", default=[], choices=list(GROUPS), help="group to draw; repeat")
    arguments = parser.parse_args()
    main(arguments.out, arguments.only)
