"""``python -m ldbb_bayes``."""

from ldbb_bayes.cli.main import main

main()
