"""``python -m groupstart``."""

from groupstart.cli import main

main()
