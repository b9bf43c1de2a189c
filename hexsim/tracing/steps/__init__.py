"""The steps of a trace in their order: one file a row of docs/tracing.md, each from one state to the next."""

from hexsim.tracing.steps import (
    balance_search,
    declared_refit,
    dominant,
    experiments,
    held_out_errors,
    hypotheses,
    learned,
    noise_only,
    residuals,
    shapes,
    simulated_search,
    ties,
    verdict,
    violations,
)

STEPS = (
    violations.STEP,
    shapes.STEP,
    balance_search.STEP,
    declared_refit.STEP,
    hypotheses.STEP,
    dominant.STEP,
    simulated_search.STEP,
    verdict.STEP,
    noise_only.STEP,
    ties.STEP,
    residuals.STEP,
    learned.STEP,
    experiments.STEP,
    held_out_errors.STEP,
)
