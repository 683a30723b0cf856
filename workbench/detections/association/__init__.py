"""Multi-person data association: detections joined across views and over time."""
