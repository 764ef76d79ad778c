"""What every device of a kind must do, real, simulated or replayed: test classes that each
implementation runs through.

A subclass supplies the fixtures named in its base's docstring, devices neither open nor started;
its module imports the base class by name, which pytest does not collect because it does not begin
with Test.
"""

import numpy as np
import pytest

from drivers.errors import DeviceError, DeviceTimeout, OutOfLimits
from drivers.protocols import Actuator, Camera, ForceSource, Frame, LostFrame, TriggerTrain

TRAIN = TriggerTrain(first=0, divisor=100)


class ForceSourceContract:
    """Fixture `forces`: a force source that delivers as fast as it is read."""

    def test_it_is_a_force_source(self, forces):
        assert isinstance(forces, ForceSource)
        assert forces.name
        assert forces.sample_rate_hz > 0
        assert forces.block_samples >= 1

    def test_blocks_follow_each_other_from_sample_0_without_gap(self, forces):
        forces.open()
        forces.start(TRAIN)
        expected = 0
        for _ in range(5):
            block = forces.read(5.0)
            assert block.first == expected
            assert block.volts.shape == (forces.block_samples, 2)
            assert block.volts.dtype == np.float64
            assert np.isfinite(block.volts).all()
            assert forces.backlog() >= 0
            expected = block.end
        forces.close()

    def test_the_receiver_owns_the_block(self, forces):
        forces.open()
        forces.start(TRAIN)
        first = forces.read(5.0)
        kept = first.volts.copy()
        second = forces.read(5.0)
        second.volts[:] = 0
        np.testing.assert_array_equal(first.volts, kept)
        forces.close()

    def test_out_of_order_use_is_a_device_error(self, forces):
        with pytest.raises(DeviceError):
            forces.start(TRAIN)
        forces.open()
        with pytest.raises(DeviceError):
            forces.read(0.01)
        forces.start(TRAIN)
        forces.stop()
        with pytest.raises(DeviceError):
            forces.read(0.01)
        forces.close()
        with pytest.raises(DeviceError):
            forces.read(0.01)

    def test_stop_and_close_may_come_at_any_time_and_twice(self, forces):
        forces.close()
        forces.open()
        forces.stop()
        forces.start(TRAIN)
        forces.stop()
        forces.stop()
        forces.close()
        forces.close()

    def test_it_says_what_it_is(self, forces):
        forces.open()
        assert forces.describe()
        forces.close()


class CameraContract:
    """Fixtures `camera`, `run_until(sample)`, which starts the clock and lets it pass up to there,
    and `end_clock()`, which ends it.
    """

    def test_it_is_a_camera(self, camera):
        assert isinstance(camera, Camera)
        assert camera.name
        assert camera.exposure_samples >= 1

    def test_one_frame_per_trigger_in_order(self, camera, run_until):
        camera.open()
        camera.start(TRAIN)
        for index in range(4):
            sample = TRAIN.sample(index)
            run_until(sample + camera.exposure_samples)
            answer = camera.read(5.0)
            assert isinstance(answer, Frame)
            assert (answer.index, answer.sample) == (index, sample)
        camera.close()

    def test_frames_wait_to_be_read(self, camera, run_until):
        camera.open()
        camera.start(TRAIN)
        run_until(TRAIN.sample(2) + camera.exposure_samples)
        answers = [camera.read(5.0) for _ in range(3)]
        assert [answer.index for answer in answers] == [0, 1, 2]
        assert all(isinstance(answer, Frame | LostFrame) for answer in answers)
        camera.close()

    def test_the_image_is_read_only_and_stays_as_it_is(self, camera, run_until):
        camera.open()
        camera.start(TRAIN)
        run_until(TRAIN.sample(1) + camera.exposure_samples)
        first = camera.read(5.0)
        assert first.image.shape == camera.shape
        assert first.image.dtype == camera.dtype
        assert not first.image.flags.writeable
        kept = first.image.copy()
        camera.read(5.0)
        np.testing.assert_array_equal(first.image, kept)
        camera.close()

    def test_a_trigger_that_has_not_come_is_a_timeout_and_may_still_come(self, camera, run_until):
        camera.open()
        camera.start(TRAIN)
        with pytest.raises(DeviceTimeout):
            camera.read(0.01)
        run_until(TRAIN.sample(0) + camera.exposure_samples)
        assert camera.read(5.0).index == 0
        with pytest.raises(DeviceTimeout):
            camera.read(0.01)
        camera.close()

    def test_what_was_exposed_when_the_clock_ended_can_still_be_read(
        self, camera, run_until, end_clock
    ):
        camera.open()
        camera.start(TRAIN)
        run_until(TRAIN.sample(1) + camera.exposure_samples)
        end_clock()
        assert [camera.read(5.0).index for _ in range(2)] == [0, 1]
        with pytest.raises(DeviceTimeout):
            camera.read(0.5)
        camera.close()

    def test_out_of_order_use_is_a_device_error(self, camera):
        with pytest.raises(DeviceError):
            camera.start(TRAIN)
        camera.open()
        with pytest.raises(DeviceError):
            camera.read(0.01)
        camera.close()
        with pytest.raises(DeviceError):
            camera.read(0.01)

    def test_stop_and_close_may_come_at_any_time_and_twice(self, camera):
        camera.close()
        camera.open()
        camera.stop()
        camera.start(TRAIN)
        camera.stop()
        camera.stop()
        camera.close()
        camera.close()

    def test_it_says_what_it_is(self, camera):
        camera.open()
        assert camera.describe()
        camera.close()


class ActuatorContract:
    """Fixtures `actuator`, free to move both ways, and `pass_time(seconds)`: lets that much of its
    own time pass.
    """

    def test_it_is_an_actuator(self, actuator):
        assert isinstance(actuator, Actuator)
        assert actuator.name
        low, high = actuator.travel_limits_m
        assert low < high
        assert actuator.velocity_limit_m_s > 0

    def test_it_says_what_it_is(self, actuator):
        actuator.open()
        assert actuator.describe()
        actuator.close()

    def test_a_move_ends_by_itself_at_its_target(self, actuator, pass_time):
        actuator.open()
        start = actuator.position_m()
        assert not actuator.is_moving()
        for target in (start + 200e-6, start - 100e-6):
            actuator.set_velocity(100e-6)
            actuator.move_to(target)
            assert actuator.is_moving()
            pass_time(0.5)
            assert actuator.is_moving()
            pass_time(5.0)
            assert not actuator.is_moving()
            assert actuator.position_m() == pytest.approx(target, abs=1e-6)
        actuator.close()

    def test_it_moves_at_about_the_velocity_asked(self, actuator, pass_time):
        actuator.open()
        start = actuator.position_m()
        actuator.set_velocity(50e-6)
        actuator.move_to(start + 1e-3)
        pass_time(2.0)
        assert actuator.position_m() - start == pytest.approx(100e-6, rel=0.1)
        actuator.close()

    def test_stop_ends_the_motion_now(self, actuator, pass_time):
        actuator.open()
        actuator.stop()
        start = actuator.position_m()
        actuator.set_velocity(100e-6)
        actuator.move_to(start + 1e-3)
        pass_time(1.0)
        actuator.stop()
        actuator.stop()
        stopped = actuator.position_m()
        assert start < stopped < start + 1e-3
        pass_time(1.0)
        assert not actuator.is_moving()
        assert actuator.position_m() == pytest.approx(stopped, abs=1e-6)
        actuator.close()

    def test_what_is_out_of_limits_changes_nothing(self, actuator, pass_time):
        actuator.open()
        low, high = actuator.travel_limits_m
        start = actuator.position_m()
        for target in (low - 1e-3, high + 1e-3, float("nan")):
            with pytest.raises(OutOfLimits):
                actuator.move_to(target)
            assert not actuator.is_moving()
        actuator.set_velocity(100e-6)
        for velocity in (0.0, -1e-6, 2 * actuator.velocity_limit_m_s, float("nan")):
            with pytest.raises(OutOfLimits):
                actuator.set_velocity(velocity)
        actuator.move_to(start + 100e-6)
        pass_time(0.5)
        assert actuator.position_m() - start == pytest.approx(50e-6, rel=0.1)
        actuator.close()

    def test_out_of_order_use_is_a_device_error(self, actuator):
        with pytest.raises(DeviceError):
            actuator.move_to(0.0)
        with pytest.raises(DeviceError):
            actuator.set_velocity(1e-6)
        with pytest.raises(DeviceError):
            actuator.position_m()

    def test_close_stops_and_may_come_at_any_time_and_twice(self, actuator, pass_time):
        actuator.close()
        actuator.open()
        start = actuator.position_m()
        actuator.move_to(start + 1e-3)
        actuator.close()
        actuator.close()
        pass_time(1.0)
        actuator.open()
        assert actuator.position_m() == pytest.approx(start, abs=1e-6)
        actuator.close()
