"""The numbers that tracing rests on: each once, with its unit and its reason. docs/tracing.md says where they decide.

What follows from them is derived where it is used. Numbers of a motion, a window or a picture stand in their modules.
"""

from hexsim.inference.remainder import OWN
from hexsim.inference.verdict import GATES

# Chance, and what passes for a difference
ERRORS = 3.0  # standard errors from which something is there: chance brings it once in 370 times
SIGNIFICANT = (
    25.0  # fall of chi2 in units of the reduced one: five standard errors, none of a thousand columns by chance
)
CERTAIN = SIGNIFICANT**0.5  # the same in standard errors
DOUBT = GATES.chance  # share of the traces in which chance may take a name that makes no held-out channel worse
MODEL_SHARE = 2.0e-3  # of the noise's mean square: two implementations of one model differ by it
# Shares of a mean square
SLIGHT = 0.03  # what a candidate, a form or a signal adds and is not preferred for: a sixth of an rms
TELLABLE = 0.1  # less is not told apart: of 200 correlation times, two runs of 20 s, it is known to sqrt(2/200)
MAIN = 0.5  # more than half: the main part
EXPLAINS = 0.4  # least share of all rows that an effect takes; at 0.5 4 of 569 true names are lost
RESTORES = 0.7  # or of its own balance above the noise, also held out; at 0.5 three null machines more get a name
SAME = OWN  # of a column's size beside others: what has less of its own is one term with them
SHARPENED = 0.8  # of a standard error: from a dozen blocks it is known to a fifth, so that no smaller change is said
TRADES = 0.9  # correlation from which two numbers trade: each is known 2.3 times better where the other is known
TAIL = 0.03  # of the samples: an end of a signal, a few dozen occasions in a run
# Residuals against their noise
NEAR = 4.0  # times chi2: a residual twice as large; what is further off is another thing
VIOLATED = 1.25  # times the largest null run: for a noise that a sheet states too small; 156 null benches hold with it
NOISE_WINDOWS = ((1, 1.08), (25, 1.6), (400, 3.0))  # (samples averaged, largest rms over the noise of their mean);
#   beyond 1 because the controller's own reading noise moves the machine and no simulation knows it
NULL_SEEDS = 30  # null runs: chance exceeds the largest of them once in 31
INPUT_SEEDS = 3  # simulations of what no simulation can know; their mean square is averaged over SPREAD_S besides
# Time [s]
REST_TIME_S = 0.2  # correlation time of what is left: that far apart its samples count as independent
REST_BLOCK_S = 10.0 * REST_TIME_S  # blocks of what a model leaves: their means are independent
BLOCK_S = 0.5  # blocks of scores and of cross-validation: longer than oil rings, short enough for some tens of blocks
OPENING_S = 6.0  # of each run: rivals are refitted on them first, and a hexapod's null runs last so long
LONG_S = 60.0  # of a longer log that the declared machine's refit begins with; its columns are not kept
SPREAD_S = 0.1  # over which oil is seen to ring, and a spread of simulations is averaged: oil rings several times
LONGEST_DELAY_S = 0.5  # of a channel that can still be aligned
# What is known of a machine before any log
CLOCK_S = 1.0e-4  # a log's clock; an accelerometer that is later has no gain that is sure
READING = 1.0e-3  # gain that a writer's integrator may be off by, relative
KNOWN = 5.0e-3  # what is weighed or measured at a machine, relative: hardly anybody knows it better
REMARKABLE = 1.5  # times its ordinary size: below that a machine is not remarkable for an effect
REMARKABLE_SHARE = 0.4  # of the typical size, for an effect without an ordinary size
HELD = 1.0e-4  # standard deviation of a number that is held to its declaration, relative
# The search
MOST_EFFECTS = 3  # of a hypothesis: each takes a round of refits, and a fourth was never needed
FEW = 4  # of what is tried or said one by one; twice as many by their columns, four times in the balances, which are quick
MAX_STEPS = 14  # of Gauss-Newton: a refit ends long before
FEW_STEPS = 6  # of one that shows whether a rival is far
START = 0.5  # typical sizes at which a refit begins where no column tells the size
LARGEST_START = 3.0  # typical sizes at which any refit begins
BASE_TOLERANCE = 0.02  # a refit of the declared machine stops when a step takes less of the excess chi2
LEAST_STEP = 0.01  # of finite differences: half widths of a declared parameter, coordinates of an effect
AT_END = GATES.end  # of a bound: a number as near to it is at the end of its range
FOLDS = 6  # of the blocks, or runs: each is predicted from the others
# Measurements that are designed
MOTION_S = 20.0  # as the guide asks of a log to fit
LOG_RATE_Hz = 1000.0  # of the log of a motion that nobody has measured
HEAVIER = 1.5  # times a machine's own load: one that is thought of where nobody has said what can be put on
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
    return max(SIGNIFICANT, MODEL_SHARE * n)
