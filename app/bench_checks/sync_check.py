"""`slipscope check --sync`: measures when a bench counts the exposure of a trigger, and how soon a
stop is sent; nothing moves.
"""

from __future__ import annotations

import time
from collections.abc import Iterator

import numpy as np

from analysis.arrays import I64
from analysis.calibration.timing import exposure_lags
from app.bench_checks.doctor import Checked, problem
from app.settings.sections import Config
from app.settings.sync_certificate import Certificate, write
from app.system.time_of_day import now
from drivers.bench import Bench, block_s
from drivers.errors import DeviceError
from drivers.protocols import SampleBlock, TriggerTrain

TRIGGERS = 40
STOPS = 10
READ_TIMEOUT_S = 3.0


def sync_check(config: Config, bench: Bench) -> Iterator[Checked]:
    """The findings, and the certificate if the exposures begin with their edge; the devices are
    opened and closed.
    """
    try:
        with bench:
            certificate = measure(config, bench)
        path = write(config, certificate)
    except (DeviceError, OSError) as error:
        yield problem("synchronisation", str(error), needed=True)
        return
    yield Checked("synchronisation", f"{certificate}; kept in {path.name} for later sessions")


def measure(config: Config, bench: Bench) -> Certificate:
    """Lag and jitter of the exposures that the board counts, and the time of a stop.

    Raises
    ------
    DeviceError
        A device fails, no exposure is counted, or what is counted is not their beginning.
    """
    train = TriggerTrain(0, config.camera.divisor)
    name = bench.forces.name
    if not bench.forces.counts_exposures:
        raise DeviceError(
            f"{name}: the synchronisation was to be measured, no counter of exposures is set; wire"
            " the camera's exposure output and set forces.exposure_counter"
        )
    counts, read_s = _counts(bench, train)
    rate, open_ = bench.forces.sample_rate_hz, bench.camera.exposure_samples
    sent = train.count_before(len(counts) - open_)
    lags = exposure_lags(counts, train.first, train.divisor)
    if not len(lags):
        raise DeviceError(
            f"{name}: {sent} triggers were sent, the board counted no exposure; check the exposure"
            " wire, forces.exposure_terminal and camera.exposure_line"
        )
    lag, jitter = float(np.median(lags)), int(np.ptp(lags))
    edge = config.forces.exposure_edge
    if open_ >= 3 and abs(lag - open_) <= max(1.0, 0.1 * open_):
        other = "falling" if edge == "rising" else "rising"
        raise DeviceError(
            f"{name}: the {edge} edge of the exposure output comes {lag / rate * 1e3:g} ms after"
            f" the trigger, which is the exposure time: it is the end of the exposure, because the"
            f" line is inverted (as behind a pull-up); set forces.exposure_edge = '{other}'"
        )
    if lag > 1 or jitter > 2 or abs(len(lags) - sent) > 1:
        raise DeviceError(
            f"{name}: {sent} triggers, {len(lags)} counted exposures, {lag / rate * 1e3:g} ms"
            f" after the trigger within {jitter / rate * 1e3:g} ms; the images of exposures that"
            " begin more than a sample after their trigger may stay uncertain: check trigger line,"
            " trigger delay and exposure wire, or lower forces.sample_rate"
        )
    stop_s = block_s(bench) + read_s + _stop_s(bench)
    in_ms = 1e3 / rate
    return Certificate(now(), edge, lag * in_ms, jitter * in_ms, len(lags), stop_s * 1e3)


def _counts(bench: Bench, train: TriggerTrain) -> tuple[I64, float]:
    """Exposures counted by each sample, and the longest that a block waited beyond its time."""
    samples, parts = TRIGGERS * train.divisor, []
    end, late_s = 0, 0.0
    bench.camera.start(train)
    bench.forces.start(train)
    try:
        while end < samples:
            block = bench.forces.read(READ_TIMEOUT_S + block_s(bench))
            if not isinstance(block, SampleBlock) or block.exposures is None:
                raise DeviceError(
                    f"{bench.forces.name}: samples were lost during the measurement;"
                    " end other programs and measure again"
                )
            parts.append(block.exposures)
            end = block.end
            late_s = max(late_s, bench.forces.backlog() / bench.forces.sample_rate_hz)
    finally:
        bench.forces.stop()
        bench.camera.stop()
    return np.concatenate(parts), late_s


def _stop_s(bench: Bench) -> float:
    """The longest of some stops of the stage, which stands."""
    longest = 0.0
    for _ in range(STOPS):
        began = time.monotonic()
        bench.actuator.stop()
        longest = max(longest, time.monotonic() - began)
    return longest
