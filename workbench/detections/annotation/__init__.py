"""Manual annotation of joints in a video, on a web page served to the local browser."""
