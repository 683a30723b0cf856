"""Marking joints in a video by hand, on a page that only this machine can open."""
