"""What `teachers/grade.py` consists of: a cage for students' code, a wire into it, the judge outside, and the pages."""
