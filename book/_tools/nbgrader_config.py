"""Grading a class with nbgrader: put this file into the folder of the course; the page for teachers shows the commands.

The stubs of the chapters are kept as they are, and a check that only says "Not yet" while a student works becomes one
that fails when it is graded.
"""

from nbgrader.preprocessors import NbGraderPreprocessor

c = get_config()  # noqa: F821 - nbgrader defines it
c.CourseDirectory.course_id = "pfslam"
c.ExecutePreprocessor.timeout = 600


class ChecksFail(NbGraderPreprocessor):
    """Turn ``chNN.check_name(answer)`` in the cells with points into an assertion."""

    def preprocess_cell(self, cell, resources, index):
        if cell.cell_type == "code" and cell.metadata.get("nbgrader", {}).get("grade"):
            cell.source = f"verdict = {cell.source.strip()}\nassert verdict, verdict"
        return cell, resources


KEEPING_THE_STUBS = ("LockCells", "ClearOutput", "CheckCellMetadata", "ComputeChecksums", "SaveCells")
c.GenerateAssignment.preprocessors = [f"nbgrader.preprocessors.{name}" for name in KEEPING_THE_STUBS]
GRADING = ("Execute", "LimitOutput", "SaveAutoGrades", "CheckCellMetadata")
c.Autograde.autograde_preprocessors = [ChecksFail, *(f"nbgrader.preprocessors.{name}" for name in GRADING)]
