"""What a reader finds on every page: contents, figures that answer a question, the reports beside it."""

import re

from made_up_run import made_up_run

from hexsim.qualification.plots import CAPTIONS as QUALIFY
from hexsim.recording.report import CAPTIONS, question, render, run_report
from hexsim.studies.valve_report import CAPTIONS as VALVE
from hexsim.tracing.report.page import CAPTIONS as TRACE


def test_the_contents_lead_to_every_part():
    """Each heading of a page has one link in its contents, in the order of the page, and its figures begin with a question."""
    page = run_report(made_up_run(), {"motion": b"\x89PNG"})
    contents = re.findall(r'<a href="#(part-\d+)">(.*?)</a>', page)
    assert contents == re.findall(r'<h2 id="(part-\d+)">(.*?)</h2>', page)
    assert len(contents) >= 4
    assert '<p class="question">Does the platform follow?</p>' in page
    assert page.index('class="lead"') < page.index('class="contents"')


def test_every_figure_has_a_question():
    """Captions of all pages begin with the question that the figure answers."""
    for captions in (CAPTIONS, QUALIFY, VALVE, TRACE):
        for caption in captions.values():
            asked, rest = question(caption)
            assert asked.endswith("?") and rest, caption


def test_names_in_a_page_make_no_heading():
    """A title that looks like a heading stays text."""
    page = render("valve.html.j2", title="<h2>odd</h2>", how="", rows=[], pictures=[], config="<h2>x</h2>")
    assert ">odd<" not in page and ">x<" not in page
