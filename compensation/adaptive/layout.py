"""The one layout of the adaptive algorithm's state: a flat array of 8-byte numbers, doubles and integers, named.

`STATE` is a numpy record; its fields lie one after the other without gaps, as in a C struct of `double` and `int64_t`
in the same order. Everything that the step reads or writes lies in it, settings and data sheet too, so that the step
allocates nothing. A history is an array, newest first unless its comment says so. Truth values are integers, 0 or 1.
"""

from __future__ import annotations

from ..damping_design import MAX_DAMPING_TAPS
from ..loop_feedback import LOOP
from ..prediction import MAX_LOOK, PREDICTION, PREVIEW_TICKS
from ..records import record

FIT_SIZE = 7  # most parameters of a fit
LEAD_TAPS = 10
LEAD_TICKS = PREVIEW_TICKS - 4  # by which the lead looks ahead; PREVIEW_TICKS lie up to the tick boundary of the demand
MAX_SHIFT = MAX_LOOK - PREVIEW_TICKS  # further ticks that a long lag is looked ahead for
DEMANDS = MAX_LOOK + 1
PATH_FINE, PATH_BEFORE, PATH_AFTER = 10, 3, 5  # samples a tick of the crossing's path, ticks before and after it
PATH = (PATH_BEFORE + PATH_AFTER) * PATH_FINE
CROSSING_TICKS = 7  # whose oil is reckoned where a spool jumps across an overlap, the third one crosses it
RESPONSE = 40  # ticks of the spool's response that a design looks at
SPOOLS = 17  # of the bank that tells delay from spool
BEFORE, AFTER, PAST_VOLTS = 14, 16, 12  # ticks about a reversal that are compared, and of volts before them
TRIM_TICKS = 8  # on either side of a compensated reversal
LAG_TICKS = 8  # that a valve's lag may span
LATES = 15  # by how much a position may be late
LATE_TICKS = 7
REACH = 16  # ticks on either side of a reversal in which Stribeck friction is looked for
LENGTHS = 12  # of bristles, of the bank
BLOCK, APART = 5, 20  # ticks of the performance monitor

FIT = record(  # recursive_least_squares.py
    theta=("f8", (FIT_SIZE,)), scale=("f8", (FIT_SIZE,)), covariance=("f8", (FIT_SIZE, FIT_SIZE)),
    work=("f8", (FIT_SIZE,)), n="i8", directional="i8", memory="f8", forgetting="f8", residual="f8", count="i8",
)  # fmt: skip
EDGE = record(  # valve_edge.py
    plain_fit=FIT,  # k, k delta, k tau
    backlash_fit=FIT,  # the same and k h
    windows="f8", gain_m_s_V="f8", dead_band_V="f8", lag_s="f8",
    root="f8",  # R^ of the last window
    misfit_allowed="f8", least_V="f8",  # dead band: 0, or negative on a four-way valve with underlap
    backlash_V="f8",  # half width, 0 until it is taken into account
    fitted_backlash_V="f8",
    significant="i8",  # backlash: from then on b is found from where the volts reverse
    ready="i8", rejections="i8",  # how often it was ready and then did not fit
    windows_needed="f8",
    noise_m="f8",  # of a window
)  # fmt: skip
VALVE = record(  # valve.py
    edges=(EDGE, (2,)),  # retracting, extending
    tick_s="f8", window="i8", min_speed_m_s="f8",
    settle="i8",  # ticks after the volts change sign in which the spool crosses
    direction="i8", wait="i8", count="i8",
    start_m="f8", start_V="f8", start_through_V="f8",  # z, |u| and |p| at the window's start
    past_V=("f8", (LAG_TICKS,)),  # of a four-way valve
    sums=("f8", (4,)),  # of u R, R, b R, s R
    reversal_V="f8", side="f8",  # b, s
    moving="i8", with_backlash="i8",
    pending="i8", phi=("f8", (3,)), phi_backlash=("f8", (4,)), moved_m="f8",  # the window before this one
    lag_s="f8",
    null_V="f8",  # volts that lie in the middle between both edges
    leak_m_s="f8", leak_ratio="f8",  # oil that flows into the chamber while the valve is closed, at the reference drop; R^2
    leak_known="i8", null_rate_V_s="f8",
    half_windows="i8", last_half_windows="i8",  # windows in this half stroke, and in the one before
    four_way="i8", differential="i8",
    underlap="i8",  # both edges are open at null: windows keep clear of where they are
    across_Pa="f8",  # P1 - P2, as it leaks across the piston
    across_sum="f8", across_phi="f8", across_means=("f8", (2,)), across_squares="f8", across_m_s_Pa="f8",  # piston_leak.py
    ticks="i8",  # since the last window that was used
)  # fmt: skip
STRIBECK = record(  # stribeck.py
    tick_s="f8", pressure_Pa="f8", reversals="i8", direction="f8",
    known="f8",  # reversals that what windows told counts for
    ticks="i8",  # since the velocity changed sign
    deviation_Pa=("f8", (2 * REACH + 1,)), position_error_m=("f8", (2 * REACH + 1,)), share=("f8", (2 * REACH + 1,)),
    most_weight="f8",  # of a slow reversal
    noise_m="f8", noise_Pa="f8",  # of a position, of a pressure
    at_rest="f8",  # P_s that a half step stands for at the last reversal; 0 before the first one
)  # fmt: skip
PRESLIDING = record(  # presliding.py
    noise_m="f8", noise_Pa="f8",
    length_m="f8",  # L
    bristle="f8",  # s of the reference
    sign=("f8", (2 * REACH + 1,)), travel_m=("f8", (2 * REACH + 1,)), share=("f8", (2 * REACH + 1,)),
    step_Pa=("f8", (2 * REACH + 1,)),
    squares=("f8", (LENGTHS,)), products=("f8", (LENGTHS,)), shapes=("f8", (LENGTHS,)), weight="f8",
    missing=("f8", (6,)), profile=("f8", (6,)), left=("f8", (LENGTHS,)),  # work
)  # fmt: skip
FRICTION = record(  # friction.py
    fit=FIT, stribeck=STRIBECK, presliding=PRESLIDING, tick_s="f8", stroke_m="f8", window="i8", min_speed_m_s="f8", position_weight="f8",
    count="i8", start_m="f8", middle_m="f8", sum_load="f8", sum_a="f8",
    windows=("i8", (2,)),  # retracting, extending
    half_step_Pa="f8", phi=("f8", (FIT_SIZE,)), noise_MPa="f8",  # of a window's mean
    stribeck_velocity_m_s="f8",
    told="i8",  # the load is told by a platform, whose other legs bias the half step while they engage
)  # fmt: skip
REFERENCE = record(  # reference.py: y_m at the tick boundary looked at last
    tick_s="f8",
    loop_1_s=("f8", (2,)),  # s Kp, retracting and extending
    dead_band_m=("f8", (2,)),  # delta / Kp
    null_m="f8",  # null / Kp
    leak_m_s="f8",  # velocity that a leak gives at closed valve
    load_m_s2="f8",  # what the load's pressure goes with: y_m'', or of a platform's leg what the setpoints of all legs ask for
    expected_m_s2="f8",  # of the setpoints, at that boundary
    load_lag_m_s2="f8",  # by which the load of the reference lags it
    load_given="i8",  # 1 for the step to come, 2 for the last one
    feed_forward="f8", linear="f8",  # g, h
    position_m="f8", velocity_m_s="f8", acceleration_m_s2="f8",
    lag_m="f8",  # r - y_m
)  # fmt: skip
INVERSE = record(  # inverse.py
    tick_s="f8", started="i8",
    oil_m="f8",  # demanded oil displacement at the last boundary
    flows_m_s=("f8", (2,)),  # demanded oil velocity of the last two ticks
    flow_V=("f8", (3,)),  # for the flow, the next to leave first
    crossing_V=("f8", (2,)),  # crossing flow compensation of the two ticks to come
    dead_band_V=("f8", (2,)),  # dead-band compensation of the two ticks before
    crossed="i8", old_m_s="f8",  # the newest tick but one crosses the overlap; the flow before it
    path_flow_V=("f8", (CROSSING_TICKS,)), path_dead_V=("f8", (CROSSING_TICKS,)),  # work of crossing_oil.py
    crossing_m_s=("f8", (CROSSING_TICKS - 1,)),
)  # fmt: skip
ROUNDING = record(  # edge_rounding.py
    prior_V="f8", largest_V="f8", straight_V="f8", lower_errors="f8", least_probe_V="f8",
    square_V2="f8", variance_V4="f8", noise_m="f8",  # of a passage
    misfit="f8",  # mean square of a passage's excess, over its expected variance
    backlash_V="f8",  # volts behind the backlash
    spool_V="f8", rate_V="f8",  # of the spool, a tick
    lag_s="f8", model=("f8", (4,)),  # of the spool, and the lag it was made for
    probe_V="f8",  # rounding that phi is computed with
    ticks="i8",  # of the passage; 0 = none
    start_m="f8",  # oil displacement at its start
    sharp_m="f8", rounded_m="f8",  # oil that sharp edges would have let through since, and rounded ones beyond that
    closed_ticks="i8",  # for which the overlap closed the valve
)  # fmt: skip
LEAK = record(  # leak.py
    leak_m_s="f8", variance="f8", passages="i8", misfit="f8", restarts="i8", noise_m="f8",  # of a passage
    positive="i8",  # the passage came from there
    excess_m="f8", closed_s="f8",
)  # fmt: skip
TRIM = record(  # edge_rounding.py
    rounding_V="f8",
    minimum_V="f8",  # no less is used while compensation engages
    known="i8",  # the rounding is identified or given, and not trimmed alone
    direction="f8", ticks="i8",
    reversal_m="f8",  # oil displacement less the demanded one, at the reversal
    before_m="f8",  # by how much it had grown before, against the new direction
)  # fmt: skip
DELAY = record(  # delay.py
    tick_s="f8", sums=("f8", (SPOOLS * LATES,)), reversals="i8", noise_m="f8",  # of an oil displacement
    declared="i8",  # whether the data sheet gives the spool
    scale="f8", damping="f8",  # of the bank's spools: lags over SPOOL_LAGS_S; damping ratio
    heard=("f8", (SPOOLS * LATES,)), heard_reversals="f8",  # the same of the other legs of a machine
    told_s=("f8", (2,)),  # start parameters: the delay, and how much of it is the position's; 0 = not told
    tells="i8", hears="i8",  # a reversal was judged in this tick; one was heard of
    volts_V=("f8", (BEFORE + AFTER + PAST_VOLTS,)), oil_m=("f8", (BEFORE + AFTER + 1,)),  # oldest first
    direction="f8",
    ticks="i8",  # since the demanded flow reversed
    tested="i8",  # spools compared with the reversal in hand; -1 = none is
    task_volts_V=("f8", (BEFORE + AFTER + PAST_VOLTS,)), task_oil_m=("f8", (BEFORE + AFTER + 1,)),
    dead_bands_V=("f8", (2,)), rounding_V="f8", lag_s="f8", compliance_m_Pa="f8",
    found=("f8", (SPOOLS * LATES,)),
    pressures_Pa=("f8", (BEFORE + AFTER + 1 + LATE_TICKS,)),  # oldest first
    task_pressures_Pa=("f8", (LATES, BEFORE + AFTER + 1)),  # by how late the position is
    roots=("f8", (2, BEFORE + AFTER)), task_gains_m_s_V=("f8", (2, BEFORE + AFTER)),  # R of the edges, k R
    least_m2="f8", best_product="f8", best_square="f8",
    pressure_square="f8", pressure_product="f8",  # of pressure and oil that is missing
    error_m=("f8", (BEFORE + AFTER + 1,)), pulse=("f8", (5 * (PAST_VOLTS + 2),)),  # work
)  # fmt: skip
LATENESS = record(tick_s="f8", late_s="f8", pressures_Pa=("f8", (LATE_TICKS + 2,)))  # lateness.py  # fmt: skip
TRUST = record(noise_Pa="f8", error_m_s2="f8", trusted="i8", since_s="f8", turning_s="f8", direction="f8")  # trust.py
SHAKEN = record(  # monitor.py: h of a position, and its range since the last reversal
    positions_m=("f8", (3 * BLOCK,)), sums_m=("f8", (3,)), accelerations_m_s2=("f8", (2 * APART + 1,)),
    count="i8",  # ticks, until the filter is filled
    low_m_s2="f8", high_m_s2="f8",
)  # fmt: skip
MONITOR = record(  # monitor.py
    tick_s="f8", noise_m="f8",  # standard deviation of a position
    piston=SHAKEN, off=SHAKEN,  # off: the piston less the reference
    baseline_m_s2=("f8", (2,)), reversal_m_s2=("f8", (2,)), excess_m_s2=("f8", (2,)),  # retracting after it first, then extending
    usual_m_s2=("f8", (2,)), least_m_s2=("f8", (2,)),  # mean and smallest of plain control's bumps of late
)  # fmt: skip
ENGAGEMENT = record(  # engagement.py
    phase="i8",
    ramp="f8",  # 0 plain control, 1 compensated
    ramp_step="f8",  # a tick
    friction_share="f8",  # of the demanded pressure
    trips="i8",  # reversals worse than the baseline, not forgiven yet
    good_reversals="i8",  # since the last trip
    lockout_s="f8",  # left
    direction="f8",  # velocity of the reference, last seen other than 0
    reversal_ticks="i8",  # since its last reversal
    half_ticks="i8",  # between the last two: the half stroke
    after_reversal="i8",  # a fifth into a half stroke: a reversal can be judged, disengaging may begin
    between="i8",  # from there to the middle of it: far from either reversal
    lost_ticks="i8",  # for which the valve has not been identified
    engage_window="i8",  # two fifths into it, the valve having been open for long enough
    open_ticks="i8",  # for which plain control has held the valve open
    closed_ticks="i8",  # for which the overlap closed it, at the last reversal
    acceleration_m_s2="f8",  # of the setpoint, low-pass
    excitation_m_s2="f8",  # its recent peak
    peak_m_s2="f8",  # since the last reversal was judged
    strongest_m_s2="f8",  # reversal of late
    reversal_m_s2="f8",  # at the last reversal
    excited="i8",
    stability_limit_m_s2="f8",  # reversal acceleration below which compensation disengages
    armed="i8",  # started with what was learned: engages before the first reversal
    follows_V="f8",  # largest of late by which the loop brings a compensated piston back to the reference
    other="i8",  # the lockout is of a machine that is not the one that was learned
    asks="i8", ticks="i8",  # a platform's leg that is to engage and not ready yet; ticks of a platform's leg
    asked_s="f8", joined_s="f8",  # for which another leg that asks, one that is compensated, is remembered
    waited_s="f8",  # for which this leg, ready itself, has waited
    ready_s="f8",  # for which it counts as ready, though a check fails at the last reversal
)  # fmt: skip
DEMAND = record(  # demand.py: of the tick boundaries to come, the nearest first
    count="i8", pressure_Pa=("f8", (DEMANDS,)),  # P1 - Ps A2/A1
    stribeck_share=("f8", (DEMANDS,)),  # of the Stribeck pressure in it, signed
    acceleration_m_s2=("f8", (DEMANDS,)), position_m=("f8", (DEMANDS,)), oil_m=("f8", (DEMANDS,)),
    velocity_m_s=("f8", (DEMANDS,)), sign=("f8", (DEMANDS,)), step_Pa=("f8", (DEMANDS,)),  # of friction
)  # fmt: skip
CHAMBERS = record(  # chamber_pressures.py: of a four-way valve
    bottom_Pa="f8", top_Pa="f8", supply_Pa="f8", mean_bottom_Pa="f8", mean_top_Pa="f8",  # now; over the tick past
    tops_Pa=("f8", (DEMANDS,)), off_Pa="f8", oil_m="f8", across_Pa="f8",  # asked for, newest first
)  # fmt: skip
SETTINGS = record(  # configuration (`Adaptive`) and data sheet (`Context`); doubles alone
    tick_s="f8", position_gain_V_per_m="f8", voltage_max_V="f8", stroke_m="f8", area_ratio="f8",
    pipeline_length_m="f8", bulk_modulus_Pa="f8", tank_pressure_Pa="f8", position_noise_m="f8",
    position_resolution_m="f8", pressure_noise_Pa="f8", pressure_resolution_Pa="f8", spool_damping="f8",
    spool_frequency_Hz="f8", stribeck_velocity_m_s="f8", controller_feeds_forward="f8", reference_drop_Pa="f8", lead_smoothing="f8",
    step_min_s="f8", step_max_s="f8", jerk_m_s3="f8", presliding_m_s="f8", damping_1_s="f8", damping_count="f8",
    damping_low_Hz="f8", damping_high_Hz="f8", damping_max_V="f8", window_s="f8", min_speed_m_s="f8",
    memory_windows="f8", engage_s="f8", feed_forward_s="f8", disengage_s="f8", max_stability_limit_m_s2="f8",
    min_excitation_m_s2="f8", learn="f8", rod_ratio="f8", pipeline_length_top_m="f8",
    velocity_gain_V_s_per_m="f8", velocity_pole="f8", velocity_share="f8", pressure_gain_V_per_Pa="f8",
    pressure_pole="f8", pressure_share="f8", edge_V="f8", velocity_gain_m_s_V="f8", supply_pressure_Pa="f8",
)  # fmt: skip
DESIGN = record(  # taps.py, least_squares.py: work
    past=("f8", (LEAD_TAPS,)), response=("f8", (RESPONSE,)),
    triangle=("f8", (MAX_DAMPING_TAPS + 1, MAX_DAMPING_TAPS + 1)), row=("f8", (MAX_DAMPING_TAPS + 1,)),
)  # fmt: skip
STATE = record(
    settings=SETTINGS, valve=VALVE, friction=FRICTION, reference=REFERENCE, inverse=INVERSE, engagement=ENGAGEMENT,
    monitor=MONITOR, trust=TRUST, rounding=ROUNDING, leak=LEAK, trim=TRIM, delay=DELAY, lateness=LATENESS, prediction=PREDICTION,
    demands=DEMAND, loop=LOOP, chambers=CHAMBERS,
    lag_s="f8", delay_s="f8",  # spool lag that the taps were designed for, and how much of it is delay and no spool
    resonance_Hz="f8",  # of the load on the oil, for the damping; 0 = unknown
    viscous_share="f8",  # rate at which viscous friction damps it, over `damping_1_s`
    shift="i8",  # ticks that the taps lie earlier
    lead_taps=("f8", (LEAD_TAPS,)), crossing_taps=("f8", (LEAD_TAPS,)), crossing_path=("f8", (PATH,)),
    lead_path=("f8", (PATH,)),  # of the spool that follows a step of the flow
    damping_taps=("f8", (MAX_DAMPING_TAPS,)),
    flow_V=("f8", (LEAD_TAPS,)), dead_band_V=("f8", (LEAD_TAPS,)),  # spool demand for the flow; across the dead band
    deviation_Pa=("f8", (MAX_DAMPING_TAPS,)), mean_deviation_Pa="f8",  # measured less demanded pressure; slow mean
    last_bottom_Pa="f8", mean_bottom_Pa="f8",  # bottom pressure at the tick before; slow mean
    supply_Pa="f8", mean_supply_Pa="f8",  # low-pass of the supply pressure; slow mean
    oil_error_m=("f8", (TRIM_TICKS + 1,)),  # z - z_m
    leaked_m="f8",  # oil that the leak has let in, as travel
    backlash_input_V="f8",  # volts fed forward, followed within the width of the backlash inverse
    damping_gain="f8",
    design_wanted="i8",  # the taps are to be designed anew
    design=DESIGN,
)  # fmt: skip
# What was learned, as it is kept and restored; doubles alone.
EDGE_LEARNED = record(
    theta=("f8", (3,)), theta_backlash=("f8", (4,)), windows="f8", ready="f8", gain_m_s_V="f8", dead_band_V="f8",
    lag_s="f8", backlash_V="f8",
)  # fmt: skip
LEARNED = record(
    flow=record(null_V="f8", leak_m_s="f8", retract=EDGE_LEARNED, extend=EDGE_LEARNED), rounding_V="f8",
    friction=record(theta_MPa=("f8", (6,)), windows=("f8", (2,)), half_step_Pa="f8", stribeck_Pa="f8"),
    delay=record(sums=("f8", (SPOOLS * LATES,)), reversals="f8", late_s="f8", oil=("f8", (2,)), told_s=("f8", (2,))),
    presliding=record(squares=("f8", (LENGTHS,)), products=("f8", (LENGTHS,)), shapes=("f8", (LENGTHS,)), weight="f8"),
    plain_control=record(baseline_m_s2=("f8", (2,)), reversal_m_s2=("f8", (2,)), follows_V="f8"),
)  # fmt: skip
