"""The driver of the SMC100 in a bench of its own, which waits as long as a busy computer needs."""

from drivers.stages import newport_line
from drivers.stages.newport_stage import Smc100


class PatientSmc100(Smc100):
    """The same, and more patient."""

    def open(self):
        """Also for the other calls of this process."""
        newport_line.ANSWER_S, newport_line.PATIENCE_S = 3.0, 30.0
        super().open()
