"""Annotating joints in a video by hand, on a page that this machine serves to its own browser."""
