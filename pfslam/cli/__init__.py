"""The command line: its options, what each command does, and what it says and draws."""
