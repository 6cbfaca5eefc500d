"""Words of a command line as numbers, with messages that name the option."""

import math


def parse_count(value: str | int | float, name: str, low: int) -> int:
    """A whole number that may be written as 1e6; ValueError if it is none or less than `low`."""
    try:
        number = float(value)
    except ValueError:
        number = math.nan
    if not (math.isfinite(number) and number == int(number) and number >= low):
        raise ValueError(f"{name} must be a whole number of at least {low}, such as 1e6; got {value!r}.")
    return int(number)


def parse_alpha(value: str | int | float, alpha_y: float | None = None) -> list[float]:
    """ "0.5" or "0.5,0.2", or α_y by itself, as [α] or [α_x, α_y]; ValueError otherwise."""
    try:
        values = [float(part) for part in str(value).split(",")]
    except ValueError:
        values = []
    if len(values) not in (1, 2):
        raise ValueError(f"--alpha must be one number or two with a comma, such as 0.5 or 0.5,0.2; got {value!r}.")
    if alpha_y is None:
        return values
    if len(values) == 2:
        raise ValueError(f"--alpha-y goes with one number in --alpha; got --alpha {value} --alpha-y {alpha_y:g}.")
    return [*values, alpha_y]


def check_angles(theta: float, phi: float) -> None:
    """Raise ValueError unless the direction of incidence is above the horizon."""
    if not 0 <= theta < math.pi / 2:
        raise ValueError(
            f"--theta must lie in [0, pi/2) radians, above the horizon; got {theta:g}. For light from inside a "
            "dielectric pass --eta 1/eta."
        )
    if not math.isfinite(phi):
        raise ValueError(f"--phi must be a finite number of radians; got {phi}.")
