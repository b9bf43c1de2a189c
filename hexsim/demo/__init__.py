"""What hexsim does, in four acts and one page: a bump, the bump compensated, a hidden effect named, the machine live."""

from hexsim.demo.acts import Act, demo

__all__ = ["Act", "demo"]
