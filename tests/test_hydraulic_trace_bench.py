"""HydraulicTraceBench: its scorer counts what is known, its cases are those of the manifest, its page is that of its answers."""

import importlib.util
import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
BENCH = ROOT / "benchmarks" / "hydraulic_trace_bench"
LARGE = {"names": ["spring"], "where": "leg 4", "value": 3000.0}
TRUTH = {
    "hexapod": {"group": "hexapod", "large": LARGE, "outside": None, "small": {"null_offset in leg 2": 0.004}},
    "leg": {"group": "rough", "large": {**LARGE, "where": "leg 1"}, "outside": None, "small": {"null_drift": 3e-4}},
    "outside": {"group": "clean", "large": None, "outside": "a bump", "small": {}},
    "clean": {"group": "clean", "large": None, "outside": None, "small": {}},
    "rough": {"group": "rough", "large": None, "outside": None, "small": {"null_drift": 3e-4}},
}


def module(name: str):
    """A script of the benchmark as a module."""
    spec = importlib.util.spec_from_file_location(f"hydraulic_trace_bench_{name}", BENCH / f"{name}.py")
    assert spec and spec.loader
    made = sys.modules[spec.name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(made)
    return made


@pytest.fixture
def scored(tmp_path):
    """Scores of answers by the command: (exit code, its score.json or None, stderr)."""

    def run(answers):
        for name, content in (("truth", TRUTH), ("answers", answers)):
            (tmp_path / f"{name}.json").write_text(json.dumps(content), encoding="utf-8")
        names = [str(tmp_path / f"{name}.json") for name in ("truth", "answers", "score")]
        command = [
            sys.executable,
            "-I",
            "-S",
            BENCH / "score.py",
            *names[:2],
            "--json",
            names[2],
        ]  # the standard library alone
        ended = subprocess.run(command, capture_output=True, text=True)
        return ended.returncode, json.loads(Path(names[2]).read_text()) if not ended.returncode else None, ended.stderr

    return run


CASES = [  # case, its findings (name or names, with place and number), score
    ("hexapod", [(["spring"], "leg 4", 3400.0)], "right"),
    ("hexapod", [(["spring"], "leg 3", 3000.0)], "wrong"),
    ("hexapod", [(["spring"], None, None)], "wrong"),
    ("hexapod", [(["spring", "mass_change"], "leg 4", None)], "tied"),
    ("hexapod", [(["spring", "a", "b", "c", "d"], "leg 4", None)], "wrong"),
    ("hexapod", [(["null_offset"], "leg 2", None)], "silent"),
    ("hexapod", [(["null_offset"], "leg 1", None)], "wrong"),
    ("hexapod", [(["spring"], "leg 4", None), (["mass_change"], "machine", None)], "wrong"),
    ("hexapod", [], "silent"),
    ("leg", [(["spring"], None, None)], "right"),
    ("leg", [(["spring"], "leg 1", None), (["null_drift"], "leg 1", None)], "right"),
    ("leg", [(["unknown"], None, None)], "silent"),
    ("outside", [(["unknown"], None, None)], "right"),
    ("outside", [(["spring"], None, None)], "wrong"),
    ("outside", [], "silent"),
    ("clean", [], "right"),
    ("clean", [(["unknown"], None, None)], "wrong"),
    ("rough", [(["unknown"], None, None)], "right"),
    ("rough", [(["null_drift"], None, None)], "right"),
    ("rough", [(["spring"], None, None)], "wrong"),
]


def test_known_answers_have_known_scores():
    """Each rule of the README, for and against a method."""
    score = module("score")
    for case, findings, wanted in CASES:
        answer = [{"names": names, "where": where, "value": value} for names, where, value in findings]
        assert score.score_case(TRUTH[case], answer)[0] == wanted, (case, findings)


def test_the_command_counts_with_intervals(scored):
    """Counts of answered cases alone; the interval of 2 of 3 is Clopper and Pearson's; a number off by 20 % is not right."""
    code, found, _ = scored(
        {"hexapod": [{"names": ["spring"], "where": "leg 4", "value": 3600.0}], "clean": [], "outside": []}
    )
    total = found["rows"][-1]
    assert (code, found["answered"], found["of"], found["cases"]["outside"]) == (0, 3, 5, "silent")
    assert [total[kind] for kind in ("right", "tied", "wrong", "silent")] == [2, 0, 0, 1]
    assert total["interval"]["right"] == pytest.approx(
        [0.0943, 0.9916], abs=1e-4
    )  # tables of the binomial distribution
    assert (total["numbers_right"], total["numbers"]) == (0, 1)


@pytest.mark.parametrize("answers", [{"none": []}, {"leg": {}}, {"leg": [{"names": "spring"}]}, {"leg": [{}]}, []])
def test_bad_answers_are_refused_with_one_sentence(scored, answers):
    """Exit code 2, one line, no traceback."""
    code, _, said = scored(answers)
    assert code == 2 and len(said.splitlines()) == 1 and "Traceback" not in said


def test_a_misspelt_name_is_said(scored):
    """It counts as wrong, and stderr names it: the score of a typing error is not taken for the method's."""
    code, score, said = scored({"leg": [{"names": ["sprng"]}], "rough": [{"names": ["unknown"]}]})
    assert code == 0 and score is not None
    assert said.splitlines() == ["answers: sprng is no name of effects.json, and counts as wrong"]


def test_cases_are_those_of_the_manifest(tmp_path):
    """200 cases with known names; the truth of every eighth, and the content of one leg that is made anew, have not changed."""
    make = module("make_cases")
    known = json.loads((BENCH / "cases.json").read_text(encoding="utf-8"))["cases"]
    names = json.loads((BENCH / "effects.json").read_text(encoding="utf-8"))
    cases = make.all_cases()
    assert len(cases) == 200
    for case in cases[::8]:
        truth = make.truth_of(case)
        assert make.hash_of_truth(truth) == known[case.name]["truth_sha256"]
        assert set(truth["large"]["names"] if truth["large"] else []) <= set(names)
        assert {label.partition(" in ")[0] for label in truth["small"]} <= set(names)
    case = next(case for case in cases if case.group == "rough")
    assert make.write_case(case, tmp_path) == known[case.name]["content_sha256"]
    log = tmp_path / case.name / "fit.csv.gz"
    assert sorted(path.name for path in tmp_path.iterdir()) == [case.name] and log.stat().st_size < 150_000


def test_the_page_is_that_of_the_answers():
    """docs/results/hydraulic_trace_bench.md is what `results_page.py` writes."""
    page = module("results_page")
    assert page.PAGE.read_text(encoding="utf-8") == page.page()
