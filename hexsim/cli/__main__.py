"""python -m hexsim.cli: the same command line."""

from hexsim.cli import main

main()
