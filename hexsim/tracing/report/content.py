"""What a trace writes: report.json, machine.toml with the fitted parameters and effects, report.html, scenarios."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from hexsim.files.json_files import write_json
from hexsim.hydraulics.advice import advice_of
from hexsim.inference.stated import chance, hydraulic
from hexsim.machine import save_machine
from hexsim.recording.quantity import quantity, split_key
from hexsim.tracing import rules
from hexsim.tracing.fitting.fit import Fit
from hexsim.tracing.fitting.fitted_numbers import totals_of
from hexsim.tracing.fitting.parameters import Candidate, end_of_range, to_value
from hexsim.tracing.report.hidden import reached_limits, would_show
from hexsim.tracing.report.page import report_page
from hexsim.tracing.report.trades import trade_entries
from hexsim.tracing.state import NamedEffect, Reading, Trace, UnexplainedResidual, Violation


def finite(x: float | None) -> float | None:
    """A number that JSON knows."""
    return None if x is None or not math.isfinite(x) else float(x)


def report_of(result: Trace) -> dict[str, Any]:
    """The content of report.json."""
    return {
        "verdict": result.verdict,
        "machine": result.machine.name,
        "remarks": remarks(result),
        "balances": [balance_entry(line) for line in result.violations],
        "effects": [
            effect_entry(effect)
            | {"in_all": total_entries(effect, result.final)}
            | chance(hydraulic(result.verdict, effect.tied_with))
            for effect in result.effects
        ]
        + [rest for rest in result.learned],
        "unexplained": [unexplained_entry(rest) for rest in result.unexplained],
        "detectable": detectable(result),
        "would_show": would_show(result),
        "parameters": parameter_entries(result),
        "budget": [
            row | {"rms": finite(row["rms"]), "multiple_of_noise": finite(row["multiple_of_noise"])}
            for row in result.budget
        ],
        "error": {
            log: {name: {kind: finite(value) for kind, value in row.items()} for name, row in channels.items()}
            for log, channels in result.error.items()
        },
        "findings": {
            name: [{"severity": f.severity, "channel": f.channel, "description": f.description} for f in findings]
            for name, findings in result.findings.items()
        },
        "trades": trade_entries(result),
        "separating_experiments": result.experiments,
        "steps": [{"name": s.name, "seconds": round(s.seconds, 2), "sentence": s.sentence} for s in result.steps],
    }


def remarks(result: Trace) -> list[str]:
    """What must be known before a verdict is believed: numbers that the refit drives to their limit, runs that it makes worse."""
    found = []
    for prior, deviation in zip(result.final.priors, result.final.deviations, strict=True):
        if abs(deviation) > 0.999 * prior.half_width:
            fitted, unit = prior.declared * (1 + deviation), split_key(prior.key)[1]
            found.append(
                f"the refit drives {prior.key} from {quantity(prior.declared, unit, 4)} to its limit "
                f"{quantity(fitted, unit, 4)}: its uncertainty may be "
                "too small, or it stands for what is missing"
            )
    found += [own.sentence for own in result.predicted]
    found += result.refused
    for run, channels in result.error.items():
        worse = {
            name: row["refit"] / max(row["declared"], 1e-300)
            for name, row in channels.items()
            if row["refit"] > (1.0 + rules.TELLABLE) * max(row["declared"], row["noise"])
        }
        if worse:
            name = max(worse, key=lambda one: worse[one])
            unit = split_key(name)[1]
            found.append(
                f"the refit makes held-out run {run} worse in {name}, from "
                f"{quantity(channels[name]['declared'], unit)} to {quantity(channels[name]['refit'], unit)}"
            )
    return found


def place_name(where: str) -> str:
    """leg i, all legs or platform."""
    return "platform" if where.startswith("platform") else where


def balance_entry(line: Violation) -> dict[str, Any]:
    return {
        "name": line.name,
        "where": place_name(line.where),
        "violation": finite(line.violation),
        "null": finite(line.null),
        "violated": line.violated,
        "rms": finite(line.rms),
        "unit": line.unit,
    }


def effect_entry(effect: NamedEffect) -> dict[str, Any]:
    candidate = effect.candidate
    where = candidate.where if candidate.effect.places != "platform" else "platform"
    if candidate.effect.places == "leg" and where == "all legs" and effect.single_leg:
        where = "leg 1"
    return {
        "name": candidate.effect.name,
        "balance": candidate.effect.balance,
        "where": where,
        **number_entries(effect),
        "tied_with": list(effect.tied_with),
        "term": candidate.effect.term,
        "one_term_with": [
            {
                "name": own.candidate.effect.name,
                "check_first": advice_of(own.candidate.effect.name).check,
                **number_entries(own),
            }
            for own in effect.readings
        ],
        "evidence": {
            "block_cv_gain": finite(effect.gain_cv),
            "blocks": effect.blocks,
            "share_of_rest": finite(effect.share),
            "dBIC": finite(effect.d_bic),
            "held_out_gain": [finite(gain) for gain in effect.held_out],
        },
        "description": candidate.effect.description,
        "check_first": advice_of(candidate.effect.name).check,
    }


def total_entries(effect: NamedEffect, fit: Fit) -> list[dict[str, Any]]:
    """The declared parameters that an effect adds to, with it; none where a leg has a value of its own."""
    if effect.candidate not in fit.candidates or fit.values[fit.candidates.index(effect.candidate)] != effect.values:
        return []
    return [
        {
            "key": own.key,
            "declared": own.declared,
            "half_width": own.half_width,
            "value": finite(own.value),
            "standard_error": finite(own.standard_error),
            "known_better": own.known_better,
        }
        for own in totals_of(fit, effect.candidate)
    ]


def number_entries(effect: NamedEffect | Reading) -> dict[str, Any]:
    """Numbers with their standard errors. at_bound: those at an end of their range, which the logs may ask beyond; unmoved:
    those whose change changes nothing in the logs. Of neither is the error one."""
    numbers = [n for n in effect.candidate.effect.parameters if n.name in effect.values and not n.of_the_file]
    ends = {n.name: end for n in numbers if (end := end_of_range(n, effect.values[n.name]))}
    return {
        "parameters": {name: finite(value) for name, value in effect.values.items()},
        "standard_error": {name: finite(value) for name, value in effect.standard_errors.items()},
        "at_bound": ends,
        "unmoved": [n.name for n in numbers if n.name not in ends and effect.standard_errors.get(n.name) == 0.0],
    }


def unexplained_entry(rest: UnexplainedResidual) -> dict[str, Any]:
    found = rest.dependence
    return {
        "balance": rest.balance,
        "where": place_name(rest.violation.where),
        "rms": finite(rest.violation.rms),
        "unit": rest.violation.unit,
        "depends_on": found.signal,
        "form": found.form,
        "r2_cv": finite(found.r2_cv),
        "frequency_Hz": finite(found.frequency_Hz),
        "memory_s": finite(found.memory_s),
        "r2_of_signals": {name: finite(value) for name, value in found.table.items()},
        "curve": {
            "signal": [float(x) for x in found.knots],
            "residual": [float(x) for x in found.curve],
            "standard_error": [float(x) for x in found.curve_sd],
        },
    }


def detectable(result: Trace) -> dict[str, Any]:
    """Smallest size of each effect that the fit runs would show: sqrt(alarm) standard deviations of the sensors' noise.

    Of a limit the largest that they would show, with its other numbers as they are looked for.
    beside_rest: the smallest that would be named beside what no model of this machine explains.
    """
    found: dict[str, Any] = {}
    limits, hidden, alarm = reached_limits(result), result.hidden, rules.alarm(result.screened)
    for line in sorted(result.screening, key=lambda line: line.sd):
        effect = line.candidate.effect
        if effect.name in found or not math.isfinite(line.sd):
            continue
        size = effect.parameters[0]
        least = math.sqrt(alarm) * line.sd
        found[effect.name] = {
            "theta_min": finite(limits.get(effect.name, abs(to_value(size, least)))),
            "unit": size.unit,
            "parameter": size.name,
            "explained_by_parameters": finite(line.explained_by_others),
        }
        if effect.name in hidden:
            found[effect.name]["beside_rest"] = finite(hidden[effect.name].size)
        if math.isinf(size.neutral):
            found[effect.name]["description"] = "seen where the value is below this" + shape_words(line.candidate)
        if effect.shown_by:
            found[effect.name]["shown_by"] = effect.shown_by
    return dict(sorted(found.items()))


def shape_words(candidate: Candidate) -> str:
    """Of a limit the other numbers beside which it would be seen."""
    start, others = candidate.start(), candidate.effect.parameters[1:] if candidate.effect.limit else ()
    said = [f"{split_key(p.name)[0].replace('_', ' ')} {quantity(start[p.name], p.unit)}" for p in others]
    return f", beside {' and '.join(said)}" if said else ""


def parameter_entries(result: Trace) -> dict[str, Any]:
    fit = result.final
    errors = np.sqrt(np.maximum(np.diag(fit.covariance), 0.0)) if fit.covariance is not None else None
    entries = {}
    for j, (prior, deviation) in enumerate(zip(fit.priors, fit.deviations, strict=True)):
        entries[prior.key] = {
            "declared": prior.declared,
            "fitted": float(prior.declared * (1 + deviation)),
            "shift_sigma": float(deviation / (prior.half_width / math.sqrt(3.0))),
            "standard_error": None if errors is None else float(errors[j] * prior.half_width * prior.declared),
            "at_bound": bool(abs(deviation) > 0.999 * prior.half_width),
        }
    return entries


def write_report(result: Trace, folder: Path, declared: str | Path | None = None) -> None:
    """Write everything into the folder. declared: the file whose comments machine.toml keeps, as `save_machine` takes it."""
    folder.mkdir(parents=True, exist_ok=True)
    write_json(folder / "report.json", result.report)
    save_machine(result.fitted, folder / "machine.toml", declared)
    for name, text in result.scenarios.items():
        (folder / name).write_text(text, encoding="utf-8")

    (folder / "report.html").write_text(report_page(result), encoding="utf-8")
