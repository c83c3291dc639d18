"""Grading a class with nbgrader: put this file into the folder of the course; the page for teachers shows the commands.

The stubs of the chapters are kept as they are, and a check that only says "Not yet" while a student works becomes one
that fails when it is graded.
"""

from nbgrader.preprocessors import DeduplicateIds, NbGraderPreprocessor

c = get_config()  # noqa: F821 - nbgrader defines it
c.CourseDirectory.course_id = "pfslam"
c.ExecutePreprocessor.timeout = 600


class ChecksFail(NbGraderPreprocessor):
    """Turn ``chNN.check_name(answer)`` in the cells with points into an assertion."""

    def preprocess_cell(self, cell, resources, index):
        if cell.cell_type == "code" and cell.metadata.get("nbgrader", {}).get("grade"):
            cell.source = f"verdict = {cell.source.strip()}\nassert verdict, verdict"
        return cell, resources


class WithoutCopies(DeduplicateIds):
    """Of a cell that a student has copied, grade the last: nbgrader stops the whole run at the mark of the others."""

    def preprocess(self, nb, resources):
        nb, resources = super().preprocess(nb, resources)
        for cell in nb.cells:
            if cell.metadata.get("nbgrader", {}).get("schema_version") != 3:
                cell.metadata.pop("nbgrader", None)
        return nb, resources


KEEPING_THE_STUBS = ("LockCells", "ClearOutput", "CheckCellMetadata", "ComputeChecksums", "SaveCells")
c.GenerateAssignment.preprocessors = [f"nbgrader.preprocessors.{name}" for name in KEEPING_THE_STUBS]
GRADING = ("Execute", "LimitOutput", "SaveAutoGrades", "CheckCellMetadata")
c.Autograde.autograde_preprocessors = [ChecksFail, *(f"nbgrader.preprocessors.{name}" for name in GRADING)]
UNPACKING = ("OverwriteKernelspec", "OverwriteCells", "CheckCellMetadata")
c.Autograde.sanitize_preprocessors = [
    "nbgrader.preprocessors.ClearOutput",
    WithoutCopies,
    *(f"nbgrader.preprocessors.{name}" for name in UNPACKING),
]
