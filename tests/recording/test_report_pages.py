"""What a reader finds on every page: contents, figures that answer a question, the reports beside it."""

import importlib
import re
from pathlib import Path

from made_up_run import made_up_run

import hexsim
from hexsim.recording import page as pages
from hexsim.recording import report

ROOT = Path(hexsim.__file__).parents[1]


def test_the_contents_lead_to_every_part():
    """Each heading of a page has one link in its contents, in the order of the page, and its figures begin with a question."""
    page = report.run_report(made_up_run(), {"motion": b"\x89PNG"})
    contents = re.findall(r'<a href="#(part-\d+)">(.*?)</a>', page)
    assert contents == re.findall(r'<h2 id="(part-\d+)">(.*?)</h2>', page)
    assert len(contents) >= 4
    assert '<p class="question">Does the platform follow?</p>' in page
    assert page.index('class="lead"') < page.index('class="contents"')


def test_every_figure_has_a_question():
    """Captions of all pages begin with the question that the figure answers."""
    places = [
        path.relative_to(ROOT)
        for path in (ROOT / "hexsim").rglob("*.py")
        if "\nCAPTIONS = " in path.read_text(encoding="utf-8")
    ]
    assert len(places) >= 4
    for place in places:
        for caption in importlib.import_module(".".join(place.with_suffix("").parts)).CAPTIONS.values():
            asked, rest = pages.question(caption)
            assert asked.endswith("?") and rest, caption


def test_names_in_a_page_make_no_heading():
    """A title that looks like a heading stays text."""
    odd = pages.Section(
        "<h2>odd</h2>",
        [
            pages.table(["<i>a</i>", pages.Column("<i>b</i>", "wide")], [("<h2>x</h2>", "<h2>x</h2>")]),
            pages.text_block("<h2>x</h2>"),
        ],
    )
    page = pages.Report("<h2>odd</h2>", [odd], about="<h2>x</h2>").html()
    assert ">odd<" not in page and ">x<" not in page and "<i>" not in page


def test_long_tables_fold_and_empty_sections_are_left_out():
    """A table of many rows shows the first ones and holds all behind a click; a section without parts has no heading."""
    rows = [(f"row {k}", k) for k in range(pages.MOST_ROWS + 5)]
    long, short = pages.table(["name", "value"], rows), pages.table(["name", "value"], rows[: pages.MOST_ROWS])
    before, folded = long.split("<details>")
    assert before.count("<td>row ") == pages.MOST_ROWS and folded.count("<td>row ") == len(rows)
    assert f"all {len(rows)} rows" in folded and "<details>" not in short
    page = pages.Report(
        "title", [pages.Section("empty", [pages.table(["name"], [])]), pages.Section("full", [short])]
    ).html()
    assert ">empty<" not in page and page.count("<h2") == 1
