"""Who is who: detections of several people, told apart and joined across views and over time."""
