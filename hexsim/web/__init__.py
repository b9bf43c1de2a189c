"""The machine live on a page in the browser: sliders for what people ask about, the bump as it becomes, in large digits.

The page and the simulation are one process, reachable from this computer alone; the page loads nothing from elsewhere.
"""

from hexsim.web.flight import Flight
from hexsim.web.flight_page import FlightPage
from hexsim.web.page import Page
from hexsim.web.session import Asked, Session

__all__ = ["Asked", "Flight", "FlightPage", "Page", "Session"]
