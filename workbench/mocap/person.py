"""The body of the person a motion file was recorded from."""

from pathlib import Path

from workbench.body.limbs import Body, person
from workbench.mocap.sources import load_motion


def of_file(*, file: str, unit: str = "cm", scale: float = 1.0) -> Body:
    """The person whose skeleton `file` carries (.amc with its .asf, or .bvh in `unit`), all lengths times `scale`.

    Raises InputError as the readers do.
    """
    return person(load_motion(Path(file), unit=unit).shape.scaled(scale))
