"""The estimator's state as one flat array of 8-byte numbers with names, and what of it is kept between runs."""

from __future__ import annotations

from ..compensator import MOST_LEGS
from ..damping_design import MAX_DAMPING_TAPS, WORK
from ..loop_feedback import LOOP
from ..prediction import PREDICTION
from ..records import record
from .fit import KNOTS, LAST, LATE, LEAD, N_COLUMNS, N_START, WINDOW
from .inverse import AHEAD
from .leg import N_NUMBERS, N_SHEET, N_SPACE, N_STATES

HISTORY = 512  # ticks that are kept, a power of two: a window, its lead, and where it may begin earlier
WINDOWS, WAITING = 10, 3  # windows that the fit sees; that wait for the end of a pass
OLDER = WINDOWS  # place of an older window that is looked at again; those that wait come behind it
KEPT = 48  # older windows that are looked at again: some 25 s of a sine of 0.5 Hz
MOST_DELAY = 6  # whole ticks of a valve's delay
HALVES = 4  # half strokes by which what to expect is judged: of a sine two each way
# for leaving, as far as it has acted so long: in a motion to 3 Hz the last four may all be small, and to leave and come back is felt more
LONG = 4 * HALVES
QUEUE = AHEAD + MOST_DELAY + 2  # demanded motion from now on

f, i = "f8", "i8"
SETTINGS = record(
    tick_s=f, position_gain_V_per_m=f, voltage_max_V=f, stroke_m=f, area_bottom_m2=f, area_top_m2=f, supply_pressure_Pa=f,
    tank_pressure_Pa=f, bulk_modulus_Pa=f, pipeline_volume_m3=f, pipeline_volume_top_m3=f, four_way=f, position_error_m=f,
    pressure_noise_Pa=f, pressure_resolution_Pa=f, spool_frequency_Hz=f, stribeck_velocity_m_s=f, edge_V=f,
    velocity_gain_m_s_V=f, velocity_gain_V_s_per_m=f, velocity_pole=f, velocity_share=f, pressure_gain_V_per_Pa=f, pressure_pole=f,
    pressure_share=f, controller_feeds_forward=f, learn=f, own_mobility=f, load_over_weight=f, leg=i, legs=i,
)  # fmt: skip
PAST = record(
    position_m=(f, (HISTORY,)), bottom_Pa=(f, (HISTORY,)), top_Pa=(f, (HISTORY,)), supply_Pa=(f, (HISTORY,)), pose_m_s2=(f, (HISTORY,)),
    forces_N=(f, (HISTORY, MOST_LEGS)), speeds_m_s=(f, (HISTORY, MOST_LEGS)), mobility=(f, (HISTORY, MOST_LEGS)),
    volts=(f, (HISTORY,)), ticks=i, begin=i, odd=i, fastest_m_s=f, supply_mean_Pa=f, force_N=f, force_ticks=f,
    noise_m=f, jitter_s=f, noise_Pa=f,  # of readings; of the clock, by the noise in motion
)  # fmt: skip
WINDOW_DATA = record(
    position_m=(f, (WINDOW,)), bottom_Pa=(f, (WINDOW,)), top_Pa=(f, (WINDOW,)), supply_Pa=(f, (WINDOW,)), pose_m_s2=(f, (WINDOW,)),
    forces_N=(f, (WINDOW, MOST_LEGS)), speeds_m_s=(f, (WINDOW, MOST_LEGS)), mobility=(f, (WINDOW, MOST_LEGS)),
    load_N=(f, (WINDOW,)), others_N=(f, (WINDOW, MOST_LEGS)),
    fitted=(i, (WINDOW, MOST_LEGS)), friction_N=(f, (WINDOW,)), first=i, tells=i, begun=i,
    volts=(f, (LEAD + WINDOW,)), measured=(f, (N_START,)), start=(f, (N_START,)), reversal=f, chi=(f, (2,)), doubt_N=(f, (KNOTS,)),
)  # fmt: skip
KEPT_WINDOW = record(  # what an older window needs to be looked at again, and what it said then
    position_m=(f, (WINDOW,)), bottom_Pa=(f, (WINDOW,)), top_Pa=(f, (WINDOW,)), supply_Pa=(f, (WINDOW,)), load_N=(f, (WINDOW,)),
    volts=(f, (LEAD + WINDOW,)), measured=(f, (N_START,)), start=(f, (N_START,)), doubt_N=(f, (KNOTS,)), first=i,
    H=(f, (N_NUMBERS * (N_NUMBERS + 1) // 2,)), g=(f, (N_NUMBERS,)), cost=f, weight=f,
)  # fmt: skip
TRIAL = record(  # a pass over the windows at some numbers
    numbers=(f, (N_NUMBERS,)), start=(f, (WINDOWS + 1, N_START)), H=(f, (N_NUMBERS, N_NUMBERS)), g=(f, (N_NUMBERS,)),
    KB=(f, (WINDOWS + 1, N_START, N_NUMBERS)), kb=(f, (WINDOWS + 1, N_START)), chi=(f, (WINDOWS + 1, 2)), cost=f,
    friction_N=(f, (WINDOWS + 1, WINDOW)),
)  # fmt: skip
FIT = record(
    mean=(f, (N_NUMBERS,)), sd=(f, (N_NUMBERS,)), kind_mean=(f, (N_NUMBERS,)), kind_sd=(f, (N_NUMBERS,)),  # of machines of its kind
    low=(f, (N_NUMBERS,)), high=(f, (N_NUMBERS,)), scale=(f, (N_COLUMNS,)),
    mass_over_hold=f, told=(f, (N_NUMBERS,)), told_weight=(f, (N_NUMBERS,)), starts=i,
    best=TRIAL, trial=TRIAL, has_best=i, count=i, waiting=i, seen=i, stage=i, step=i, damping=f,
    at_window=i, at_tick=i, running=i, restored=i, settled=i, passes=i, gain=f, noise=(f, (2,)), jitter_s=f,
    colour=f, new=f, rough=(f, (2,)), rough_before=(f, (2,)), row_before=(f, (N_COLUMNS,)), residuals=(f, (LAST + 1,)),
    x=(f, (N_STATES,)), S=(f, (N_STATES, N_COLUMNS)), d_now=(f, (N_COLUMNS,)), d_before=(f, (N_COLUMNS,)), row=(f, (N_COLUMNS,)),
    late=(f, (LATE, 2)), late_S=(f, (LATE, 2, N_COLUMNS)),
    arriving=(f, (LEAD + WINDOW,)), by_half=(f, (LEAD + WINDOW,)), by_spread=(f, (LEAD + WINDOW,)),
    A=(f, (N_NUMBERS, N_NUMBERS)), B=(f, (N_START, N_NUMBERS)),
    C=(f, (N_START, N_START)), a=(f, (N_NUMBERS,)), b=(f, (N_START,)), w=(f, (N_SPACE,)), L=(f, (N_NUMBERS, N_NUMBERS)),
    proposed=(f, (N_NUMBERS,)), of_window=(f, (N_NUMBERS,)),
    before=(f, (N_NUMBERS,)), chi2=(f, (2,)), chi2_before=(f, (2,)), trying=i, tries=i, tries_seen=i,
    was_known=i, held=(f, (N_NUMBERS,)), step_to=(f, (N_NUMBERS,)),
    folded_H=(f, (N_NUMBERS, N_NUMBERS)), folded_g=(f, (N_NUMBERS,)), folded_cost=f,
    aside_H=(f, (N_NUMBERS, N_NUMBERS)), aside_g=(f, (N_NUMBERS,)), aside_cost=f, folded_until=i, folding=i, to_fold=i,
    first_cost=f, tried=f, throughout=f, throughout_before=f, kept=i, again=i, looked=i, aside_kept=i,
)  # fmt: skip
KNOWN = record(  # of the last pass that became better
    numbers=(f, (N_NUMBERS,)), factor=(f, (N_NUMBERS, N_NUMBERS)), sd=(f, (N_NUMBERS,)), chi2=(f, (2,)), valid=i, changed=i,
    alone=(f, (N_NUMBERS,)), alone_variance=(f, (N_NUMBERS,)),  # without what other legs told, in units of kind_sd about kind_mean
)  # fmt: skip
INVERSE = record(
    r=(f, (4 * AHEAD,)), r2=(f, (4 * AHEAD,)), J=(f, (4 * AHEAD, AHEAD)), S=(f, (N_STATES, AHEAD)), path=(f, (AHEAD + 1, N_STATES)),
    path2=(f, (AHEAD + 1, N_STATES)), H=(f, (AHEAD, AHEAD)), L=(f, (AHEAD, AHEAD)), step=(f, (AHEAD,)), U2=(f, (AHEAD,)),
    s=(f, (N_STATES,)), steady=(f, (AHEAD,)),
    w=(f, (N_SPACE,)), d_now=(f, (AHEAD,)), d_before=(f, (AHEAD,)), U=(f, (AHEAD,)), before=f, older=f, x=(f, (N_STATES,)),
    filtered=(f, (2,)), running=i, y=(f, (AHEAD + 1,)), v=(f, (AHEAD + 1,)), extra=(f, (AHEAD,)), plays=(f, (3,)),
    whole=i,
)  # fmt: skip
REFERENCE = record(  # the nearest tick first
    position_m=(f, (QUEUE,)), velocity_m_s=(f, (QUEUE,)), setpoint_m=(f, (QUEUE,)), extra_m_s2=(f, (QUEUE,)),
    count=i, behind_m=f, lag_m=f, load_lag_m_s2=f, load_m_s2=f, loaded=i, stale=i, late_s=f, late_sums=(f, (2,)), speed_m_s=f,
    followed_m=(f, (QUEUE + 1,)), behind_two_m=f,
)  # fmt: skip
TWIN = record(  # of the leg by the model, under plain control or with the volts: state, volts before, hysteresis, loop's own feedback
    x=(f, (N_STATES,)), before_V=f, plays=(f, (2,)), loop=LOOP,
    filtered=(f, (4, 2)),  # four low passes of the inverse are the 50 Hz band in which a bump is judged: half is left at 50 Hz
)  # fmt: skip
EXPECTED = record(
    S=(f, (N_STATES, N_NUMBERS)), speed=(f, (N_NUMBERS,)), filtered=(f, (N_NUMBERS, 2)), row=(f, (N_NUMBERS,)),
    d_now=(f, (N_NUMBERS,)), d_before=(f, (N_NUMBERS,)), x=(f, (N_STATES,)), lag_m=f, w=(f, (N_SPACE,)), scaled=(f, (N_NUMBERS,)),
    started=i, unsteady=i, acceleration=f, velocity=f, turned=i, begun=i, random=i, noise_m=f, rounded_V=f,
    plain=TWIN, compensated=TWIN, compensating=i, deviation_Pa=(f, (MAX_DAMPING_TAPS,)),
    bump=f, left=f, missed=f, sigma=f, worst=(f, (N_NUMBERS,)), halves=i,  # of this half stroke; how many before
    bumps2=(f, (LONG,)), lefts2=(f, (LONG,)), doubts2=(f, (LONG,)), rows=(f, (LONG, N_NUMBERS)), bump2=f, left2=f, sigma2=f,
    misses2=(f, (LONG,)), missed2=f, outside=i,  # half strokes before it came in
    reach_filtered=(f, (4, 2)), reach_m_s=f, reach=f, reaches2=(f, (LONG,)), reach2=f,  # if the valve had no lag
    jolt_bands=(f, (4, 2)), jolt_slow=(f, (4,)), jolt=f, jolts2=(f, (LONG,)), jolt2=f,  # of the setpoint
    seen_filtered=(f, (3,)),  # two poles would leave more noise of 18 um than bump, four less than half of a bump of 20 Hz
    seen=f, seens2=(f, (HALVES,)), plain_halves=i, was_plain=i, wrong=i,  # as read
)  # fmt: skip
# level: share of the probe; plain control's plays; those of `_through_hysteresis`
PROBE = record(level=f, plain=(f, (2,)), plays=(f, (3,)))
DAMPING = record(
    tick_s=f, damping_count=i, damping_low_Hz=f, damping_high_Hz=f, spool_damping=f,  # of the design
    taps=(f, (MAX_DAMPING_TAPS,)), deviation_Pa=(f, (MAX_DAMPING_TAPS,)), expected_Pa=(f, (MOST_DELAY + 1,)), gain=f, lag_s=f, wanted=i,
    let_out_V_Pa=f, work=WORK,
)  # fmt: skip
STATE = record(
    settings=SETTINGS, sheet=(f, (N_SHEET,)), mobility=(f, (MOST_LEGS,)), others=(f, (MOST_LEGS, N_NUMBERS)),
    heard=(i, (MOST_LEGS,)), alone=(f, (MOST_LEGS, N_NUMBERS)), alone_variance=(f, (MOST_LEGS, N_NUMBERS)), mean_N=(f, (MOST_LEGS,)),
    past=PAST, windows=(WINDOW_DATA, (WINDOWS + 1 + WAITING,)), older=(KEPT_WINDOW, (KEPT,)), fit=FIT, known=KNOWN,
    numbers=(f, (N_NUMBERS,)), inverse=INVERSE, reference=REFERENCE, expected=EXPECTED, prediction=PREDICTION, loop=LOOP, damping=DAMPING,
    probe=PROBE, asked_V=f, share=f, linear=f, linear_step=f, platform=i, objected=i, wants=i, jolts=i, jolted=i,
    said_bump2=(f, (MOST_LEGS,)), said_doubt2=(f, (MOST_LEGS,)),
)  # fmt: skip
