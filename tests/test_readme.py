"""The README: its length, its files and its six figures, held against the pages that have them with their commands."""

import json
import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
TEXT = " ".join(README.split())
RESULTS = ROOT / "docs" / "results"


def cells(page: str, first: str) -> list[str]:
    """The cells behind the first one of a table's row."""
    text = (RESULTS / page).read_text(encoding="utf-8")
    (row,) = re.findall(rf"^\| {re.escape(first)} \|(.*)\|$", text, re.MULTILINE)
    return [cell.strip() for cell in row.split("|")]


def test_it_is_short():
    """At most 600 words."""
    assert len(README.split()) <= 600


def test_every_file_it_names_is_there():
    """No link or picture of README, CONTRIBUTING, SECURITY and CHANGELOG is dead."""
    for name in ("README.md", "CONTRIBUTING.md", "SECURITY.md", "CHANGELOG.md"):
        text = (ROOT / name).read_text(encoding="utf-8")
        links = [link for link in re.findall(r"\]\(([^)#\s]+)", text) if not link.startswith("http")]
        assert links and not [link for link in links if not (ROOT / link).exists()], name


NUMBERS = ["none", "one", "two", "three", "four", "five", "six", "seven"]


def test_compensation():
    """Heave of the 600 kg machine is that of its page, and so are the targets that are met."""
    none, _, adaptive, *_ = cells("compensation_targets.md", "hexapod, heave")
    assert f"from {float(none):.2f} to {float(adaptive):.2f} m/s2" in TEXT
    page = (RESULTS / "compensation_targets.md").read_text(encoding="utf-8").split("Heave reversals")[0]
    verdicts = re.findall(r"\| (yes|\*\*no\*\*: [\d.]+ of the target) \|$", page, re.MULTILINE)
    assert f"{NUMBERS[verdicts.count('yes')]} of {NUMBERS[len(verdicts)]}" in TEXT.replace("\n", " ")


def test_undeclared_effects():
    """Benches, those with at most a fifth of the bump and the median are those of the guide."""
    page = (ROOT / "docs" / "compensation.md").read_text(encoding="utf-8")
    (found,) = re.findall(
        r"^- (\d+) benches.* at most a fifth of the bump in (\d+), median (\d\.\d+)", page, re.MULTILINE
    )
    benches, fifth, median = found
    assert f"[{benches} benches]" in TEXT and f"in {fifth}, a median of {median}" in TEXT


def test_tracing():
    """Clean machines and rough machines are those of their pages."""
    quiet = sum(int(cells("tracing.md", f"{kind}, no effect")[0]) for kind in ("bench", "hexapod"))
    assert f"[{quiet} of {quiet}]" in TEXT
    number, result = cells("tracing.md", "bench, an effect of the library")
    assert f"{result.split()[0]} of {number} benches" in TEXT
    number, right, *_, wrong = cells("tracing_rough.md", "benches with a large effect")
    count = int(right.split()[0])
    assert f"[{100 * count / int(number):.0f} %]" in TEXT and f"of {number} benches" in TEXT
    assert f"and {100 * int(wrong) / int(number):.1f} % wrongly" in TEXT


def test_speed():
    """The ratio to Exudyn is the measured one."""
    rows = {name: value for name, value, _ in json.loads((RESULTS / "speed.json").read_text())["rows"]}
    (ratio,) = (value for name, value in rows.items() if "Exudyn" in name)
    assert f"{ratio:.2f} times as fast as Exudyn" in TEXT
