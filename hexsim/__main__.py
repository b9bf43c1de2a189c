"""python -m hexsim: the command line, where its script is not on the path."""

from hexsim.cli import main

main()
