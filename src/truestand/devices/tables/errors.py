"""What drivers say when a controller is silent, talks nonsense or refuses: found, needed, what to do."""

from truestand.core.errors import DeviceError, DeviceLost


def lost(name: str, found: str) -> DeviceLost:
    """For a controller that doesn't answer, or no longer."""
    return DeviceLost(
        f"{name}: {found}; need a controller that answers there; "
        "check power, cable, and address in [devices.table] of stand.toml"
    )


def nonsense(name: str, found: str, needed: str) -> DeviceError:
    """For an answer that isn't one."""
    return DeviceError(
        f"{name}: found {found}, need {needed}; "
        "check that protocol and address in [devices.table] of stand.toml belong to this controller"
    )


def refused(name: str, found: str, advice: str) -> DeviceError:
    """For a controller that understands and doesn't want to."""
    return DeviceError(f"{name}: refused, {found}; {advice}")
