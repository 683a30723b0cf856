"""Files that datasets read: videos, marks, points."""
