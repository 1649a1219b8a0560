"""`python -m graphnav`: the command."""

from graphnav.cli.cli import main

main()
