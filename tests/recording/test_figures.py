"""Figures and reports: that they show the numbers of the log."""

import io
import re

import matplotlib
import numpy as np
import pytest
from made_up_run import BUMP_M_S2, bump, log_of, made_up_log, made_up_machine, made_up_run
from markupsafe import escape
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.image import imread as read_png

from hexsim.recording import figure_style, report, rerun_recording, summary_table
from hexsim.recording import figures as drawings
from hexsim.recording.signals import Signals

NAMES = ["motion", "acceleration", "parasitic", "flow_curve", "pressures", "spectrum"]


def line(plot, label):
    """Data of the curve with this label."""
    return next(curve.get_xydata() for curve in plot.get_lines() if curve.get_label() == label)


@pytest.mark.parametrize("margins", [None, figure_style.TITLED], ids=["laid out", "given"])
def test_a_figures_title_stands_above_its_plots(margins):
    """Whether the layout finds the room or it is given: drawn once, the title and the plots with their own titles do not overlap."""
    figure, plots = figure_style.styled(figure_style.small_multiples)(
        2, "A title as long as half of the figure, at the left", 2, margins=margins
    )
    plots[0].set_title("a plot's own title, which is long")
    figure_style.png(figure)
    renderer = FigureCanvasAgg(figure).get_renderer()
    title = figure._suptitle.get_window_extent(renderer)  # matplotlib has no public name for it
    assert max(plot.get_tightbbox(renderer).y1 for plot in plots) <= title.y0 + 1.0 < figure.bbox.y1


def test_margins_are_inches():
    """A grid's plots stand as far from the edges and from each other as its margins say, in a figure of any height."""
    margins = figure_style.Margins(left=0.7, right=0.2, top=0.5, bottom=0.4, across=0.9, between=0.6)
    for height in (2.0, 4.0):
        figure, plots = figure_style.small_multiples(4, "", 2, height, margins=margins)
        inches = figure.transFigure - figure.dpi_scale_trans
        first, second, third, last = (plot.get_position().transformed(inches) for plot in plots)
        wide, high = figure.get_size_inches()
        edges = (first.x0, wide - last.x1, high - first.y1, last.y0)
        assert edges == pytest.approx((margins.left, margins.right, margins.top, margins.bottom))
        assert (second.x0 - first.x1, first.y0 - third.y1) == pytest.approx((margins.across, margins.between))


@pytest.mark.parametrize(("hexapod", "names"), [(True, NAMES), (False, [n for n in NAMES if n != "parasitic"])])
def test_every_axis_of_every_figure_has_a_unit(hexapod, names):
    """All figures are made, in the report's order, and each y axis says its unit (its label, or the title above it)."""
    figures = drawings.run_figures(Signals.of_run(made_up_run(hexapod)))
    assert list(figures) == names
    for figure in figures.values():
        for plot in figure.axes:
            if plot.get_visible() and plot in figure.get_axes():
                assert "[" in plot.get_ylabel() + plot.get_title(loc="left"), figure.get_suptitle()
        assert figure_style.png(figure, dpi=40).startswith(b"\x89PNG")


def test_a_figure_drawn_once_is_that_of_savefig(monkeypatch):
    """Each figure has the pixels that matplotlib's `savefig` gives, which draws twice and looks for the place of each title."""
    drawn = {
        name: figure_style.png(figure, dpi=60)
        for name, figure in drawings.run_figures(Signals.of_run(made_up_run())).items()
    }
    monkeypatch.setitem(figure_style.STYLE, "axes.titley", None)
    for name, figure in drawings.run_figures(Signals.of_run(made_up_run())).items():
        usual = io.BytesIO()
        with matplotlib.rc_context(figure_style.STYLE):
            figure.savefig(usual, format="png", dpi=60)
        usual.seek(0)
        opaque = read_png(usual)
        assert np.all(opaque[..., 3] == 1.0) and np.array_equal(read_png(io.BytesIO(drawn[name])), opaque[..., :3]), (
            name
        )


def test_the_deviation_is_the_bump_that_was_drawn():
    """Acceleration = sine + bump: the raw deviation is the bump, but for what of it is in the fundamental itself.

    The packet has 1 % of its energy in the harmonic: 0.01 m/s2 covers it; a wrong phase or mean would give 0.1.
    """
    signals = Signals.of_run(made_up_run())
    _, middle, _ = drawings.acceleration(signals).axes
    data = line(middle, "raw")
    assert np.allclose(data[:, 1], bump(signals.time_s)[-len(data) :], rtol=0, atol=0.01 * BUMP_M_S2)
    peaks = line(middle, "peak at reversal")
    assert np.allclose(peaks[:, 0], [2.5, 3.5, 4.5, 5.5], rtol=0, atol=2e-3)


def test_motion_shows_setpoint_and_response_in_mm():
    """0.05 m asked reads 50 mm; the leg's error is setpoint less position."""
    run = made_up_run(False)
    heave, error = drawings.motion(Signals.of_run(run)).axes
    assert line(heave, "setpoint")[:, 1].max() == pytest.approx(150.0, abs=0.01)  # half stroke 100 mm + 50 mm
    assert np.allclose(line(error, "leg")[:, 1], 1e3 * (run.log["setpoint_m"] - run.log["position_m"]).to_numpy())


def test_what_the_log_lacks_is_not_drawn():
    """Without flow there is no flow curve; without any acceleration neither acceleration nor spectrum."""
    machine = made_up_machine(False)
    log = made_up_log(machine, 4.0).drop("flow_m3_s", "acceleration_m_s2", "true_acceleration_m_s2")
    signals = Signals(log=log_of(log, machine), machine=machine, frequency_Hz=0.5)
    assert drawings.flow_curve(signals) is None
    assert list(drawings.run_figures(signals)) == ["motion", "pressures"]


def test_the_flow_curve_leaves_out_how_the_motion_begins():
    """A point for each sample behind the fade, and none before."""
    signals = Signals.of_run(made_up_run(False))
    points = [curve for curve in drawings.flow_curve(signals).axes[0].get_lines() if curve.get_marker() == "."]
    behind = np.count_nonzero(signals.time_s >= signals.fade_s)
    assert sum(len(curve.get_xdata()) for curve in points) == behind < len(signals.time_s)


def test_comparison_has_one_row_a_run_to_one_scale():
    """Half the bump reads as half the height on the same axis, and each row names its run and its peak."""
    machine = made_up_machine(False)
    runs = {
        name: Signals(
            log=log_of(made_up_log(machine, 6.0, scale), machine),
            machine=machine,
            frequency_Hz=0.5,
            fade_s=1.0,
            figures_from_s=2.0,
        )
        for name, scale in (("none", 1.0), ("half", 0.5))
    }
    figure = drawings.comparison(runs)
    left, middle = figure.axes[0::3], figure.axes[1::3]
    assert [plot.get_ylabel() for plot in left] == ["none", "half"]
    assert middle[0].get_ylim() == middle[1].get_ylim() and left[0].get_ylim() == left[1].get_ylim()
    sizes = [np.abs(plot.get_lines()[0].get_ydata()).max() for plot in middle]
    assert sizes[1] / sizes[0] == pytest.approx(0.5, rel=0.02)  # the harmonic takes up to 1 % of each bump
    assert middle[0].texts[0].get_text() == f"peak {summary_table.number(sizes[0])}"
    assert drawings.comparison(runs, peaks={"none": 2.0}).axes[1].texts[0].get_text() == "peak 2.00"


def test_the_report_needs_nothing_but_itself():
    """All pictures and scripts are inside; no script, style sheet, image, font or data comes from elsewhere."""
    page = report.run_report(made_up_run(), {"motion": b"\x89PNG", "acceleration": b"\x89PNG"})
    assert page.count('src="data:image/png;base64,') == 2
    assert not re.search(
        r"""(src|href)\s*=\s*["'](?!data:|#)|url\(|@import|<script [^>]*src|<link|\bfetch\(|XMLHttp|import\(""", page
    )


def test_the_report_shows_the_summary_and_escapes_names():
    """Every cell of the table stands in the page; a name with markup in it stays text; a partial run is marked."""
    run = made_up_run(complete=False, compensator="<b>bold</b>", messages=[(1.5, 2, "fell back & <i>said so</i>")])
    run.summary = {**run.summary, "compensator": "<b>bold</b>"}
    page = report.run_report(run, {})
    for _, cells in summary_table.axis_rows(run.summary, ("z",)):
        assert all(f">{cell}</td>" in page for cell in cells)
    assert "&lt;b&gt;bold&lt;/b&gt;" in page and "<b>bold</b>" not in page
    assert "fell back &amp; &lt;i&gt;said so" in page
    assert "Partial run." in page and "interrupted at 3.0 s" in page


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.87965, "0.880"),
        (11.742, "11.7"),
        (1234.5, "1234"),
        (0.000123, "0.000123"),
        (1.2e-7, "1.20e-07"),
        (0.0, "0"),
        (None, "–"),
        (float("nan"), "–"),
        (-0.5, "-0.500"),
        (0.99996, "1.00"),
    ],
)
def test_numbers_keep_three_significant_places(value, text):
    """Figures are rounded to what is meant, small ones stay readable, missing ones are a dash."""
    assert summary_table.number(value) == text


def test_the_harmonic_is_that_of_the_last_periods():
    """A run that begins with half the motion is judged against the harmonic of its end, where only the bump is left."""
    machine = made_up_machine(False)
    log = made_up_log(machine, 8.0)
    share = np.where(log["time_s"] < 4.0, 0.5, 1.0)
    log = log.with_columns(true_acceleration_m_s2=log["true_acceleration_m_s2"] * share)
    found = Signals(
        log=log_of(log, machine), machine=machine, frequency_Hz=0.5, fade_s=1.0, figures_from_s=4.0
    ).deviation("leg")
    late = found.time_s >= 4.0
    assert np.allclose(found.raw[late], bump(found.time_s)[late], rtol=0, atol=0.01 * BUMP_M_S2)
    early = (found.time_s > 1.6) & (found.time_s < 1.8)  # half of 0.49 m/s2 sin(..) is missing there
    assert np.abs(found.raw[early]).min() > 0.1


def test_names_with_the_signs_of_any_markup_stay_text(tmp_path):
    """Figures are drawn, the page shows the name escaped, and the recording is written, whatever a name holds."""
    name = r"[/red] $\red$ <script>alert(1)</script> a | b & c {{ 7 * 7 }} %s \n `x`"
    run = made_up_run(False, duration_s=3.0, messages=[(1.0, 1, name)])
    run.summary = {**run.summary, "scenario": name, "machine": name, "compensator": name, "warnings": [name]}
    signals = Signals.of_run(run, name)
    figures = {**drawings.run_figures(signals), "comparison": drawings.comparison({name: signals})}
    assert figures["comparison"].axes[0].get_ylabel() == name
    page = report.run_report(run, {key: figure_style.png(figure, dpi=30) for key, figure in figures.items()})
    assert str(escape(name)) in page and "<script>alert" not in page
    rerun_recording.write_recording(
        tmp_path / "run.rrd",
        {name: signals},
        {name: summary_table.markdown(run.summary, ("leg",), run)},
        {name: run.messages},
    )
    assert (tmp_path / "run.rrd").stat().st_size > 10_000
