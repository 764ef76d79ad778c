"""What `slipscope check --sync` has measured on a bench, for the sessions that it records later."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass
from pathlib import Path

from app.settings.sections import Config
from app.settings.trusted_settings import state_folder

NAME = "synchronisation"  # among the versions in a session


@dataclass(frozen=True, slots=True)
class Certificate:
    """The measured synchronisation of a bench.

    `lag_ms` is the time from a trigger to the counted edge of its exposure, `jitter_ms` the range
    of that time, `stop_ms` the longest time that a stop took, each at the resolution of a sample.
    """

    measured: str
    edge: str
    lag_ms: float
    jitter_ms: float
    exposures: int
    stop_ms: float

    def __str__(self) -> str:
        """One sentence, for the sessions that follow."""
        return (
            f"measured {self.measured}: the {self.edge} edge comes {self.lag_ms:g} ms after the"
            f" trigger, within {self.jitter_ms:g} ms, in {self.exposures} exposures; from a limit"
            f" to ST {self.stop_ms:.0f} ms at most"
        )


def place(config: Config) -> Path:
    """Where the certificate of a bench lies: by its devices and what they are set to."""
    f, c, a = config.forces, config.camera, config.actuator
    parts = (
        *(f.source, f.device, f.server, f.exposure_counter, f.exposure_terminal, f.exposure_edge),
        *(f.sample_rate, f.block, c.source, c.device, c.exposure, c.exposure_line, c.trigger_line),
        *(a.source, a.port),
    )
    name = hashlib.sha256(json.dumps(parts).encode()).hexdigest()[:16]
    return state_folder() / "certificates" / f"{name}.json"


def write(config: Config, certificate: Certificate) -> Path:
    """Keep the certificate of this bench; an earlier one is replaced."""
    path = place(config)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(asdict(certificate)), encoding="utf-8")
    return path


def certificate_record(config: Config) -> dict[str, str]:
    """What a session says of its bench's synchronisation; nothing where it was never measured."""
    try:
        held = json.loads(place(config).read_text(encoding="utf-8"))
        return {NAME: str(Certificate(**held))}
    except FileNotFoundError:
        return {}
    except (OSError, ValueError, TypeError) as error:
        return {NAME: f"the certificate cannot be read ({error}); repeat `slipscope check --sync`"}
