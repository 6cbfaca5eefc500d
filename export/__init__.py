"""Write the set of evaluators and check each against eager: `python -m export --help`."""
