"""Dense alignment of the rendered person with the image, with derivatives."""
