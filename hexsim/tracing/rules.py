"""The rules of the verdict in one place. Frozen before they are scored; docs/tracing.md explains them."""

ALARM_CHI2 = 40.0  # least fall of chi2 by one effect, in units of the reduced chi2
# and at least this share of the samples: less is the difference between two implementations of one model
ALARM_SHARE = 2.0e-3  # of the samples
LEAST_GAIN = 0.03  # least share of the excess chi2 that an effect must take away
LEAST_GAIN_SIMULATED = 0.3  # the same in the last search, by simulation: what helps less explains nothing there
NOISE_REDUCED = 1.05  # chi2 a sample at which nothing is left to explain
NEAR_NOISE = 4.0  # chi2 a sample below which a hypothesis is judged with its own input uncertainty
PROMISE_MARGIN = 4.0  # times what its columns promise a fit may still come down: twice the change of what is left
MOST_EFFECTS = 3  # of a hypothesis: each takes a round of refits, and a fourth was never needed
REFITTED_CANDIDATES = 8  # candidates of a screening that are refitted on the opening seconds
SHAPES_REFITTED = 4  # besides, of effects with a shape, of which one column tells little
REFIT_GAIN_SHARE = 0.1  # only candidates with this share of the best linear gain are refitted
TRIAGE_S = 6.0  # [s] these opening seconds
TRIAGE_STEPS = 6  # of Gauss-Newton: a rival that is far then stays far
FINALISTS = 4  # candidates of the first refit that are refitted further
QUICK_RATIO = 3.0  # a candidate whose first refit leaves more than so many times the best one's is out
FINALIST_RATIO = 2.0  # a finalist's triage chi2 is at most so many times the best one's
NONLINEAR_START_SIZE = 0.5  # typical sizes at which a refit of a softer chamber starts
START_SIZE = 3.0  # largest typical size at which a refit starts
TIE_CHI2 = 25.0  # rivals whose chi2 is within this are a tie, in units of the reduced chi2
TIE_NEAR = 0.1  # candidates that leave less than this share of what the named effect does, by their columns
TIES_TRIED = 4  # of them are refitted at most
BLOCK_S = (
    0.5  # [s] blocks of scores and of cross-validation: longer than oil rings, short enough for some tens of blocks
)
VIOLATED = 1.25  # a balance is violated above so many times its largest null
NULL_SEEDS = 30  # null runs: chance exceeds the largest of them once in 31
NOISE_WINDOWS = ((1, 1.08), (25, 1.6), (400, 3.0))  # (samples averaged, largest rms over the noise of their mean);
#   beyond 1 because the controller's own reading noise moves the machine and no simulation knows it
LOGGED_VOLTS_MARGIN = 1.25  # on the noise that logged volts bring in: one realisation, and rounding is not random
INPUT_SHARE = 1.0  # of the position's noise: the declared loop reads its positions with it, and no simulation knows it
INPUT_SEEDS = 3  # simulations of it
INPUT_WINDOW_S = 0.1  # [s] over which its spread is averaged
LONG_S = 60.0  # [s] of a longer log that the declared machine's refit begins with; its columns are not kept
BASE_TOLERANCE = 0.02  # the declared machine's refit stops when a step takes less than this share of the excess chi2
NEGLIGIBLE_SHARE = 0.01  # an effect that vanishes at infinity does nothing below this share of its typical strength
NULL_S_HEXAPOD = 8.0  # [s] of each run that a hexapod's null simulations cover
NEAR_CHI2, NEAR_SHARE = 60.0, 0.05  # rivals in the balances that go on to the simulation: within this of the best
CONTENDERS = 2  # at most so many
SENSOR_FIRST = 1.5  # a sensor balance this far above its null is looked at first: it spoils the others
RESTORED = 1.4  # rows of the balances hold again when their rms is below so many times its null size
LEARNED_R2 = 0.5  # a residual with at least this R^2 on unseen blocks may become a learned term
PARTLY_SHARE = 0.4  # least share of the rest's mean square that an effect takes
PARTLY_SHARE_UNSEEN = 0.05  # and on held-out runs, whose motion may ask for little of it
PARTLY_RESTORED = 0.7  # or of what its own balance has above the noise, also held out
PARTLY_ABOVE_NOISE = 0.1  # mean square above the noise, in units of it, from which that can be told
PARTLY_BLOCK_S = 2.0  # [s] blocks of what a model leaves: longer than its correlation
PARTLY_SPREAD = 0.2  # a refit by simulation may move an effect's number by this share, or three standard errors
PARTLY_HARM = 0.07  # a sensor's effect may make no row's mean square larger by this share
PARTLY_LINE = 0.1  # a tone with this share of a row of continuity is no outside force; of one 0.003 at most was left,
#   of a hum of the pressure signal 0.83 and more
PARTLY_LATE_S = 1e-4  # [s] an accelerometer that is later has no gain that is sure
PARTLY_REFITTED = 16  # candidates that are refitted beside the nuisance effects, by what their columns promise
PARTLY_PROMISE = 0.3  # share of the least fall that a column, or a start, must promise to be refitted
PARTLY_NEAR = 0.8  # share of the best rival's fall of J from which a rival is refitted with all columns anew
PARTLY_TIE = 0.1  # share of the rest's mean square by which a rival must be worse to be no tie
PARTLY_TIE_UNSEEN = 0.3  # the same of a rival that leaves less of the held-out runs
GROWTH_DOUBT = 0.01  # share of the traces in which chance may take a name that makes no held-out channel worse
PREDICTED_SHARE = 0.04  # of a rest's mean square below 50 Hz that a signal may predict of noise
PREDICTED_ABOVE = 3.0  # and so many deviations of the null above the largest of it
OWN_GAIN, OWN_DELAY_S = 1e-3, 1e-4  # of a channel itself: taken off before its rest is judged
MOST_UNREMARKABLE = 2  # sure effects that are fitted and not named, because any machine may have so much of them
REMARKABLE = 1.5  # times its ordinary size: below that a machine is not remarkable for the effect
REMARKABLE_SHARE = 0.4  # of the typical size, for an effect without an ordinary size
REST_TIME_S = 0.2  # [s] correlation time of what is left: that far apart its samples count as independent
ORDINARY = {  # what a machine has of an effect without being remarkable: fitted beside every effect, never named
    "accelerometer_delay": 6.0e-4,
    "accelerometer_gain": 0.006,
    "entrained_air": 0.004,
    "friction_warm_up": 0.1,
    "leakage_chamber_to_tank": 2.0e-13,
    "leakage_supply_to_chamber": 2.0e-13,
    "null_drift": 5.0e-4,
    "null_offset": 0.008,
    "overlap_change": 5.0e-7,
    "position_delay": 6.0e-4,
    "position_ripple": 5.0e-6,
    "pressure_dependent_friction": 3.0e-6,
    "return_line_back_pressure": 1.0e8,
    "spool_lag": 100.0,
    "spring": 250.0,
    "supply_pressure_gain": 0.004,
    "unequal_ports": 0.012,
}
FADES = frozenset({"friction_warm_up"})  # one sign alone: oil and seals warm up, and friction falls


def alarm(n: int) -> float:
    """Least fall of chi2 by an effect for n samples."""
    return max(ALARM_CHI2, ALARM_SHARE * n)
