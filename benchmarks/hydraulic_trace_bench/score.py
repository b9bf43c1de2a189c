"""Score answers against the truth of HydraulicTraceBench. Needs Python 3.8 or newer and nothing else.

    python score.py truth.json answers.json
    python score.py truth.json answers.json --json score.json

answers.json: {"case_001": [{"names": ["spring"], "where": "leg 4", "value": 2900.0}], "case_002": [], ...}
A finding has one name, or up to four that the method cannot tell apart; "unknown" says that something is missing that is
not in the list. where counts on hexapods, value is optional. README.md has the rules.
"""

import argparse
import json
import math
import os
import sys

RIGHT, TIED, WRONG, SILENT = SCORES = ("right", "tied", "wrong", "silent")
MOST_TIED = 4  # names of one finding; more do not tell a mechanic what to look at
NUMBER = 0.15  # a number is right within this share of the true one
CONFIDENCE = 0.95
GROUPS = ("clean", "rough", "four_way", "hexapod")
CAUSES = ("listed", "outside", "none")


class BadFile(Exception):
    """A file that is not what the rules say; the message is one sentence."""


def true_names(truth, where):
    """Names that are in the machine at this place, its small effects included."""
    found = set(truth["large"]["names"]) if truth["large"] and at(truth["large"]["where"], where) else set()
    for label in truth["small"]:
        name, _, place = label.partition(" in ")
        if not place or at(place, where):
            found.add(name)
    return found


def at(true, said):
    """Is the place that was said the true one? Of an effect of the machine every place is."""
    return not true.startswith("leg") or true == said


def score_case(truth, findings):
    """right, tied, wrong or silent: (score, whether its number is right or None)."""
    hexapod = truth["group"] == "hexapod"
    named = [one for one in findings if one["names"] != ["unknown"]]
    for one in named:
        where = one.get("where") if hexapod else "leg 1"
        if len(one["names"]) > MOST_TIED or not true_names(truth, where) & set(one["names"]):
            return WRONG, None
    if truth["large"] is None:
        return score_without(truth, findings, named), None
    for one in named:
        where = one.get("where") if hexapod else "leg 1"
        right = at(truth["large"]["where"], where) and set(one["names"]) & set(truth["large"]["names"])
        if right:
            # names that all mean the truth are one name
            alone = set(one["names"]) <= set(truth["large"]["names"])
            return (RIGHT, number_right(truth["large"]["value"], one.get("value"))) if alone else (TIED, None)
    return SILENT, None


def score_without(truth, findings, named):
    """Score of a machine without a large effect of the list: names of its small ones are not wrong."""
    if named:
        return RIGHT if truth["outside"] is None else WRONG
    if truth["outside"] is not None:
        return RIGHT if findings else SILENT
    clean = not truth["small"]
    return WRONG if findings and clean else RIGHT


def number_right(true, found):
    """Within the share; None where either is missing."""
    if true is None or found is None:
        return None
    return abs(found - true) <= NUMBER * abs(true)


def cause_of(truth):
    """listed, outside or none."""
    return "listed" if truth["large"] else "outside" if truth["outside"] else "none"


def interval(k, n):
    """Clopper and Pearson's bounds of a share at 95 %."""
    if n == 0:
        return 0.0, 1.0
    tail = (1.0 - CONFIDENCE) / 2.0

    def at_least(p):
        return sum(math.comb(n, i) * p**i * (1.0 - p) ** (n - i) for i in range(k, n + 1))

    def at_most(p):
        return sum(math.comb(n, i) * p**i * (1.0 - p) ** (n - i) for i in range(k + 1))

    return (
        0.0 if k == 0 else crossing(lambda p: at_least(p) > tail),
        1.0 if k == n else crossing(lambda p: at_most(p) < tail),
    )


def crossing(beyond):
    """Where between 0 and 1 a condition begins to hold, by bisection."""
    low, high = 0.0, 1.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if beyond(middle) else (middle, high)
    return 0.5 * (low + high)


def table(truths, answers):
    """Rows of counts: each class that has an answered case, each cause, all."""
    scored = {name: score_case(truths[name], answers[name]) for name in answers}

    def row(label, chosen):
        counts = {score: sum(scored[name][0] == score for name in chosen) for score in SCORES}
        numbers = [scored[name][1] for name in chosen if scored[name][1] is not None]
        of = len(chosen)
        return {
            "class": label,
            "cases": of,
            **counts,
            "interval": {score: [round(x, 4) for x in interval(counts[score], of)] for score in SCORES},
            "numbers_right": sum(numbers),
            "numbers": len(numbers),
        }

    rows = []
    for cause in CAUSES:
        for group in GROUPS:
            chosen = [n for n in answers if truths[n]["group"] == group and cause_of(truths[n]) == cause]
            rows += [row(group + ", " + cause, chosen)] if chosen else []
        chosen = [n for n in answers if cause_of(truths[n]) == cause]
        rows += [row("all, " + cause, chosen)] if chosen else []
    cases = {name: scored[name][0] for name in sorted(scored)}
    return {"answered": len(answers), "of": len(truths), "rows": [*rows, row("all", list(answers))], "cases": cases}


def text_of(result):
    """The table as Markdown."""
    lines = ["| class | cases | right | tied | wrong | silent | numbers right |", "|---|---|---|---|---|---|---|"]
    for row in result["rows"]:
        cells = []
        for score in SCORES:
            low, high = row["interval"][score]
            cells.append(f"{row[score]} ({100 * low:.0f} to {100 * high:.0f} %)")
        numbers = f"{row['numbers_right']} of {row['numbers']}" if row["numbers"] else ""
        lines.append("| " + " | ".join([row["class"], str(row["cases"]), *cells, numbers]) + " |")
    return "\n".join(lines)


def read(path):
    """A JSON object of a file."""
    try:
        with open(path, encoding="utf-8") as file:
            found = json.load(file)
    except (OSError, ValueError) as error:
        raise BadFile(f"{path} cannot be read: {error}") from error
    if not isinstance(found, dict):
        raise BadFile(f"{path} must be a JSON object with a key for each case")
    return found


def checked(answers, truths):
    """The answers, if each is a list of findings for a known case."""
    for case, findings in answers.items():
        if case not in truths:
            raise BadFile(f"answers: {case} is not a case of this truth")
        if not isinstance(findings, list):
            raise BadFile(f"answers: {case} must be a list of findings, [] for none")
        for one in findings:
            names = one.get("names") if isinstance(one, dict) else None
            if not isinstance(names, list) or not names or not all(isinstance(name, str) for name in names):
                raise BadFile(f'answers: a finding of {case} needs "names", a list of one name or more')
            value = one.get("value")
            if value is not None and (isinstance(value, bool) or not isinstance(value, (int, float))):
                raise BadFile(f'answers: "value" of {case} must be a number or absent')
    return answers


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("truth")
    parser.add_argument("answers")
    parser.add_argument("--json", help="also write the counts here")
    options = parser.parse_args(arguments)
    try:
        truths = read(options.truth)
        answers = checked(read(options.answers), truths)
        result = table(truths, answers)
        listed = os.path.join(os.path.dirname(os.path.abspath(__file__)), "effects.json")
        if os.path.exists(listed):  # a slip of the pen costs a case: it is said
            said = {name for findings in answers.values() for one in findings for name in one["names"]}
            for name in sorted(said - {"unknown", *read(listed)}):
                print(f"answers: {name} is no name of effects.json, and counts as wrong", file=sys.stderr)
        if options.json:
            with open(options.json, "w", encoding="utf-8") as file:
                file.write(json.dumps(result, indent=1) + "\n")
    except (BadFile, OSError) as error:
        print(error, file=sys.stderr)
        return 2
    print(text_of(result))
    if result["answered"] < result["of"]:
        print(f"\n{result['answered']} of {result['of']} cases were answered.")
    return 0


if __name__ == "__main__":
    sys.exit(main())
