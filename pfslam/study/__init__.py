"""Many runs over parameters, seeds, buildings and data sets: one tidy table, the same on any number of workers.

>>> from pfslam.study import read_study, run_study
>>> table = run_study(read_study("my_study.toml"), "out")  # doctest: +SKIP
"""

from pfslam.study.definition import Case, Study, make_study, read_study
from pfslam.study.run import run_case
from pfslam.study.runner import run_study
from pfslam.study.table import read_table

__all__ = ["Case", "Study", "make_study", "read_study", "read_table", "run_case", "run_study"]
