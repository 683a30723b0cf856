"""The whole person laid onto the image, with derivatives: what the surface looks like, and where it ends."""
