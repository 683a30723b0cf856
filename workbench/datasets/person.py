"""The body of the person a dataset shows, where it knows them."""

from workbench.body.limbs import Body, person
from workbench.core.dataset import Known
from workbench.errors import InputError


def of_dataset(known: Known, *, scale: float = 1.0) -> Body:
    """Return the tracked body as the dataset knows it, or else its person as measured, all lengths times `scale`;
    raises InputError where it knows neither."""
    if known.body is not None:
        return known.body.scaled(scale)
    if known.shape is None:
        raise InputError("body: this dataset does not know the person's size; choose body=height body.height_m=…")
    return person(known.shape.scaled(scale))
