"""Closing the loop: recognise places after a run, and revise the whole path so that they agree."""
