"""Speed, measured: ``python -m pfslam bench``. Ratios come from jobs run side by side, round after round.

One module per group of questions; ``command`` runs them all. Nothing of this is imported by the rest of the package.
"""
