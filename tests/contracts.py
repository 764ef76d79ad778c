"""The contracts of `drivers.contracts` as test classes that each implementation runs through.

A subclass supplies the fixtures named in its base's docstring, devices neither open nor started;
its module imports the base class by name, which pytest does not collect because it does not begin
with Test.
"""

from contextlib import suppress

from drivers.contracts import CONTRACTS, TRAIN, NotTried

__all__ = ["TRAIN", "ActuatorContract", "CameraContract", "ForceSourceContract"]


def _of_forces(contract):
    return lambda self, forces: contract.check(forces)


def _of_camera(contract):
    if "end_clock" not in contract.needs:
        return lambda self, camera, run_until: contract.check(camera, run_until=run_until)
    return lambda self, camera, run_until, end_clock: contract.check(
        camera, run_until=run_until, end_clock=end_clock
    )


def _of_actuator(contract):
    def test(self, actuator, pass_time):
        with suppress(NotTried):
            contract.check(actuator, pass_time=pass_time, may_move=lambda: True)

    return test


# what only `slipscope check-driver` can do, with a device that is not in the process of the test
OUTSIDE = {"cut", "dying_move"}


def _tests(name, kind, test_of, fixtures):
    contracts = [each for each in CONTRACTS[kind] if OUTSIDE.isdisjoint(each.needs)]
    tests = {f"test_{contract.name}": test_of(contract) for contract in contracts}
    return type(name, (), {"__doc__": fixtures, **tests})


ForceSourceContract = _tests(
    "ForceSourceContract",
    "forces",
    _of_forces,
    "Fixture `forces`: a force source that delivers as fast as it is read.",
)
CameraContract = _tests(
    "CameraContract",
    "camera",
    _of_camera,
    "Fixtures `camera`, `run_until(sample)`, which starts the clock and lets it pass up to there,"
    " and `end_clock()`, which ends it.",
)
ActuatorContract = _tests(
    "ActuatorContract",
    "actuator",
    _of_actuator,
    "Fixtures `actuator`, free to move both ways, and `pass_time(seconds)`: lets that much of its"
    " own time pass.",
)
