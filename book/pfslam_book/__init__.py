"""Figures, widgets and checks for the notebooks: all that needs Matplotlib or ipywidgets."""
