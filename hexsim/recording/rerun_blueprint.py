"""How a recording opens: the machine beside its acceleration, the deviation, and the legs below."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import rerun.blueprint as rrb

from hexsim.recording.signals import AXIS_NAMES, Signals, axis_unit_text
from hexsim.signals.signal import ROTATIONS

LEG_VIEWS = {
    "Position [mm]": ("setpoint", "position"),
    "Tracking error [mm]": ("error",),
    "Valve [V]": ("valve", "compensation"),
    "Chamber pressures [bar]": ("bottom", "top"),
    "Flow [l/min]": ("flow",),
}
ALL_LEGS_VIEWS = {
    "Tracking error [mm]": "error",
    "Valve [V]": "valve",
    "Chamber pressure [bar]": "bottom",
    "Flow [l/min]": "flow",
}


def blueprint(runs: Mapping[str, Signals], with_text: Iterable[str] = ()) -> rrb.Blueprint:
    """One blueprint for one run or several; keys are roots of entity paths, `with_text` those with a summary."""
    first = next(iter(runs.values()))
    lead = first.driven_axes[0]
    single = len(runs) == 1
    unit = f"[{axis_unit_text(lead)}]"
    kinds = ("raw", "reference", "within_band") if single else ("within_band",)
    texts = [
        rrb.TextDocumentView(origin=f"/{root}/summary", name=f"Figures {'' if single else root}".strip())
        for root in with_text
    ]
    messages = rrb.TextLogView(origin="/", contents=[f"+ /{root}/messages" for root in runs], name="Messages")
    left = rrb.Vertical(_scene(runs), rrb.Tabs(*texts, messages), row_shares=[3, 2]) if texts else _scene(runs)
    middle = [
        _plot(f"Acceleration {AXIS_NAMES[lead]} {unit}", _paths(runs, f"acceleration/{lead}", kinds)),
        _plot(
            f"Deviation {AXIS_NAMES[lead]} {unit}",
            _paths(runs, f"deviation/{lead}", ("raw", "reversal_peaks", "within_band") if single else ("within_band",)),
        ),
    ]
    tabs = [_all_legs(runs)] if first.kinematics.has_platform and single else []
    tabs += [_leg(runs, leg) for leg in first.legs]
    tabs.append(_platform(runs, first))
    right = rrb.Vertical(*middle, rrb.Tabs(*tabs, active_tab=0), row_shares=[3, 3, 5])
    return rrb.Blueprint(
        rrb.Horizontal(left, right, column_shares=[2, 3]),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline="time", loop_mode="all"),
        auto_views=False,
        auto_layout=False,
    )


def _scene(runs: Mapping[str, Signals]) -> rrb.Spatial3DView:
    """Seen from the front left, a little above."""
    first = next(iter(runs.values()))
    mechanics = first.kinematics
    size = mechanics.radius_m
    away = size * (1.7 + 1.5 * len(runs))
    height = mechanics.longest_leg_m
    return rrb.Spatial3DView(
        origin="/",
        contents=[f"+ /{root}/machine/**" for root in runs],
        name="Machine",
        background=[24, 27, 33],
        line_grid=rrb.LineGrid3D(visible=True, spacing=0.5 * size, color=[58, 64, 74]),
        eye_controls=rrb.EyeControls3D(
            position=(0.92 * away, 0.5 * away, 0.55 * away),
            look_target=(0.0, 0.0, 0.45 * height),
            eye_up=(0.0, 0.0, 1.0),
        ),
    )


def _plot(name: str, contents: list[str], legend: bool = True) -> rrb.TimeSeriesView:
    """Curves over time; all plots zoom together."""
    return rrb.TimeSeriesView(
        origin="/",
        contents=contents,
        name=name,
        axis_x=rrb.TimeAxis(link="LinkToGlobal"),
        plot_legend=rrb.PlotLegend(corner="RightTop", visible=legend),
    )


def _paths(runs: Mapping[str, Signals], place: str, kinds: Iterable[str]) -> list[str]:
    return [f"+ /{root}/{place}/{kind}" for root in runs for kind in kinds]


def _all_legs(runs: Mapping[str, Signals]) -> rrb.Grid:
    views = [
        _plot(name, [path for leg in range(1, 7) for path in _paths(runs, f"legs/{leg}", (key,))], legend=False)
        for name, key in ALL_LEGS_VIEWS.items()
    ]
    return rrb.Grid(*views, grid_columns=2, name="All legs")


def _leg(runs: Mapping[str, Signals], leg: int) -> rrb.Grid:
    """All signals of a leg; of several runs what they have in common is drawn once."""
    views, first = [], next(iter(runs))
    for name, keys in LEG_VIEWS.items():
        contents = _paths(runs, f"legs/{leg}", keys)
        if len(runs) > 1:
            contents = _paths(runs, f"legs/{leg}", (keys[0] if keys[0] != "setpoint" else "position",))
            contents += [f"+ /{first}/legs/{leg}/setpoint"] if "setpoint" in keys else []
        views.append(_plot(name, contents))
    views.append(_plot("Supply [bar]", [f"+ /{root}/supply" for root in runs]))
    return rrb.Grid(*views, grid_columns=3, name=f"Leg {leg}")


def _platform(runs: Mapping[str, Signals], first: Signals) -> rrb.Grid:
    views = [
        _plot(
            f"{AXIS_NAMES[axis].capitalize()} {'[deg]' if axis in ROTATIONS else '[mm]'}",
            _paths(runs, f"pose/{axis}", ("commanded", "actual")),
        )
        for axis in first.axes
    ]
    views += [
        _plot(
            f"Deviation {AXIS_NAMES[axis]} [{axis_unit_text(axis)}]",
            _paths(runs, f"deviation/{axis}", ("within_band",)),
        )
        for axis in first.axes
        if axis != first.driven_axes[0]
    ]
    return rrb.Grid(
        *views,
        grid_columns=3 if first.kinematics.has_platform else 1,
        name="Platform" if first.kinematics.has_platform else "Motion",
    )
