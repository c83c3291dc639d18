"""Speed and memory, measured: ``python -m pfslam bench``.

``measure`` is how a figure is taken and printed, ``sections`` what is measured, ``command`` the command itself.
"""
