"""python -m gusjob."""

from gusjob.cli import main

main()
