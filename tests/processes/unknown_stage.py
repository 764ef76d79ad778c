"""A driver of somebody else, of whose stage the program knows nothing, without a `stopper`."""

from drivers.sim.devices import SimActuator


class UnknownStage(SimActuator):
    """It may be a real one for all that is known outside its bench."""

    nature = "simulated"
