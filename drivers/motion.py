"""The limits of a stage, checked before anything is sent to it."""

from __future__ import annotations

from drivers.errors import OutOfLimits


def check_velocity(name: str, velocity_m_s: float, limit_m_s: float) -> None:
    """Refuse a velocity that is not above 0 and within the limit, or that is NaN.

    Raises
    ------
    OutOfLimits
        With the limit in its message.
    """
    if not 0 < velocity_m_s <= limit_m_s:
        raise OutOfLimits(
            f"{name}: a velocity of {velocity_m_s * 1e6:.6g} um/s was requested; use one above 0"
            f" and up to {limit_m_s * 1e6:g} um/s"
        )


def check_target(name: str, position_m: float, limits_m: tuple[float, float]) -> None:
    """Refuse a target outside the travel of the stage, or that is NaN.

    Raises
    ------
    OutOfLimits
        With the travel in its message.
    """
    low, high = limits_m
    if not low <= position_m <= high:
        raise OutOfLimits(
            f"{name}: a move to {position_m * 1e3:.6g} mm was requested; its travel is"
            f" {low * 1e3:g} to {high * 1e3:g} mm"
        )
