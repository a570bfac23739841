"""Errors of the drivers for a controller that is silent, answers what is no message, or refuses."""

from truestand.core.errors import DeviceError, DeviceLost


def lost(name: str, found: str) -> DeviceLost:
    """For a controller that does not answer, or no longer."""
    return DeviceLost(
        f"{name}: {found}; need a controller that answers there; "
        "check power, cable, and address in [devices.table] of stand.toml"
    )


def malformed(name: str, found: str, needed: str) -> DeviceError:
    """For an answer that is none of the protocol."""
    return DeviceError(
        f"{name}: found {found}, need {needed}; "
        "check that protocol and address in [devices.table] of stand.toml belong to this controller"
    )


def refused(name: str, found: str, advice: str) -> DeviceError:
    """For a controller that refuses a command."""
    return DeviceError(f"{name}: refused, {found}; {advice}")
