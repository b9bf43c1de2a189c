"""python -m hexsim.cli"""

from hexsim.cli import main

main()
