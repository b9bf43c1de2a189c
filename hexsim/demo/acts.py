"""Four acts in one folder, and the page that shows them. Everything is done by the functions behind the commands."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hexsim.demo.live_act import WIDE_M, before_and_after, chart, page_picture
from hexsim.errors import HexsimError
from hexsim.files.atomic import write_text
from hexsim.files.log_files import write_log
from hexsim.machine import load_machine
from hexsim.machine.files import changed, save_machine
from hexsim.recording.figure_style import png
from hexsim.recording.figures import comparison, run_figures
from hexsim.recording.page import Report, Section, join, lead, link, picture, remark, text_block
from hexsim.recording.run_files import write_run
from hexsim.recording.signals import Signals
from hexsim.scenarios import load_scenario
from hexsim.signals.table import measured_columns
from hexsim.simulation import Run, simulate
from hexsim.smoothness.threshold import times_threshold
from hexsim.studies.compare import compare, write_comparison
from hexsim.tracing.report.budget import waterfall
from hexsim.tracing.report.tables import effect_rows
from hexsim.tracing.trace import trace

MACHINE, BENCH, MOTION = "micro_motion_system", "bench", "heave"
LEAK = "effects.leakage_supply_to_chamber.conductance_m3_s_Pa"
RUNS = {"fit": ("multisine", 1), "validate": ("heave", 2)}  # scenario, seed of the sensors' noise

Show = Callable[[str, float], None]


@dataclass(frozen=True, kw_only=True)
class Act:
    """title; sentence: what was found; look: what to look at; command: makes it alone; links: (name, path in the folder)."""

    title: str
    sentence: str
    look: str
    picture: bytes
    command: str
    links: tuple[tuple[str, str], ...] = ()


def demo(folder: Path, show: Show = lambda doing, fraction: None) -> list[Act]:
    """Play all acts into `folder` and write index.html there. show(what is being done, fraction done)."""
    begins = (0.0, 0.15, 0.4, 0.8)  # of the acts, shares of the whole time
    show("a heave and its bump", begins[0])
    plain = simulate(load_machine(MACHINE), load_scenario(MOTION), fast=True)
    acts = [bump(plain, folder)]
    show("the same with a compensator", begins[1])
    acts.append(compensated(plain, folder))
    show("a bench with a hidden leak", begins[2])
    acts.append(traced(folder, lambda doing, done: show(doing, begins[2] + done * (begins[3] - begins[2]))))
    show("the machine live", begins[3])
    acts.append(live(folder))
    about = "Hydraulic motion systems: what people feel at a reversal, where it comes from, and how it goes away."
    sections = [section(number, act) for number, act in enumerate(acts, start=1)]
    write_text(folder / "index.html", Report("hexsim in four acts", sections, about=about).html())
    show("done", 1.0)
    return acts


def section(number: int, act: Act) -> Section:
    """An act on the page."""
    links = remark(join((link(*one) for one in act.links), " · "))
    parts = [
        lead(act.sentence),
        picture(act.picture, f"What is to be seen? {act.look}"),
        text_block(act.command),
        links,
    ]
    return Section(f"{number}. {act.title}", parts)


def peak_of(run: Run) -> float:
    """Peak of the heave in the band [m/s2]."""
    return run.summary["axes"]["z"]["peak_band_m_s2"]


def bump(plain: Run, folder: Path) -> Act:
    """A heave of the 600 kg platform, as it is."""
    (folder / "1_bump").mkdir()
    write_run(plain, folder / "1_bump")
    peak, harmonic = peak_of(plain), plain.summary["axes"]["z"]["fundamental_m_s2"]
    return Act(
        title="The bump",
        sentence=f"A 600 kg platform heaves by 50 mm at 0.5 Hz; each time it turns round, dead band and friction of its "
        f"cylinders add a bump of {peak:.2f} m/s², {peak / harmonic:.1f} times the motion itself and "
        f"{times_threshold('z', peak):.0f} times what people just feel.",
        look="The middle panel: between the reversals the deviation is nearly nothing, at each reversal it jumps and rings.",
        picture=png(run_figures(Signals.of_run(plain))["acceleration"]),
        command=f"hexsim run {MOTION} --fast --out 1_bump",
        links=(("report", "1_bump/report.html"),),
    )


def compensated(plain: Run, folder: Path) -> Act:
    """The same motion with the compensator that learns."""
    (folder / "2_compensated").mkdir()
    runs = {"none": plain} | compare(plain.machine, plain.scenario, ["adaptive"], fast=True)
    write_comparison(runs, folder / "2_compensated", recording=False)
    peaks = {name: peak_of(run) for name, run in runs.items()}
    figure = comparison({name: Signals.of_run(run, name) for name, run in runs.items()}, "z", peaks)
    assert figure is not None
    return Act(
        title="The bump compensated",
        sentence=f"The compensator knows neither dead band nor friction; it identifies both while the machine moves, "
        f"and the same reversals then peak at {peaks['adaptive']:.2f} in place of {peaks['none']:.2f} m/s².",
        look="The right column, from the left: the first reversals are nearly as before, then the compensator engages.",
        picture=png(figure),
        command=f"hexsim run {MOTION} --compensator none,adaptive --fast --out 2_compensated",
        links=(("report", "2_compensated/report.html"),),
    )


def traced(
    folder: Path,
    show: Show,
    *,
    leak_m3_s_Pa: float = 1.8e-12,  # of a worn piston seal
) -> Act:
    """Logs of a bench that leaks, held against a machine file that says nothing of it."""
    place = folder / "3_hidden"
    place.mkdir()
    bench = load_machine(BENCH)
    save_machine(bench, place / "machine.toml")
    leaking = changed(bench, {LEAK: leak_m3_s_Pa})
    for name, (scenario, seed) in RUNS.items():
        log = simulate(leaking, load_scenario(scenario), seed=seed).log
        write_log(log.select("time_s", *measured_columns(bench.n_legs)), place / f"{name}.parquet")
    result = trace(place, ["fit"], ["validate"], place / "trace", show)
    return Act(
        title="A hidden effect named",
        sentence=found_sentence(result.report, leak_m3_s_Pa),
        look="The waterfall: what the declared machine gets wrong on motion that no fit has seen, what better parameters "
        "would mend of it, and what the named effect takes away. Dotted: the noise of the sensors.",
        picture=waterfall(result),
        command="hexsim trace 3_hidden --fit fit --validate validate --out 3_hidden/trace",
        links=(("report", "3_hidden/trace/report.html"),),
    )


def found_sentence(report: dict[str, Any], leak_m3_s_Pa: float) -> str:
    """What was hidden, and what the trace says of it."""
    begun = (
        f"A bench leaks {leak_m3_s_Pa:.2g} m³/s/Pa from the supply into its chamber, and its machine file does not say so; "
        "from two logs of 20 s the trace names "
    )
    found = effect_rows(report)
    if not found:
        return f"{begun}nothing (verdict: {report['verdict']})."
    numbers = "; ".join(f"{name} {value}" for name, value in found[0]["values"])
    return f"{begun}“{found[0]['title']}”, {found[0]['where']}: {numbers}."


def live(folder: Path) -> Act:
    """The machine on its page, while a slider moves."""
    machine, scenario = load_machine(MACHINE), load_scenario(MOTION)
    before, after = before_and_after(machine, scenario)
    try:
        picture, look = (
            page_picture(machine, MACHINE, scenario),
            "Left: the bump now, and dashed what it was. Move any slider.",
        )
    except HexsimError as error:
        picture = chart(before, after)
        look = f"The reversals now and before, as the page draws them (no picture of the page itself: {error})."
    (folder / "4_live.png").write_bytes(picture)
    return Act(
        title="Live, with sliders",
        sentence=f"On a page in the browser the machine runs while you change it: with the overlap of its valves moved from "
        f"{1e6 * (machine.valve.overlap_m or 0.0):.0f} to {1e6 * WIDE_M:.0f} µm the bump goes from {before.peak:.2f} to "
        f"{after.peak:.2f} m/s² within two periods.",
        look=look,
        picture=picture,
        command=f"hexsim live {MOTION} --web",
    )
