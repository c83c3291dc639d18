"""Speed and memory, measured: ``python -m pfslam bench``.

``measure`` is how a figure is taken and printed, ``sections`` what is measured, ``command`` the command itself.
What a laboratory of the book needs for one frame is measured where a browser is: ``book/_tools/frame_time.py``.
"""
