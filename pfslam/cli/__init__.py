"""The command line: what each command does, and the summary of a run."""
