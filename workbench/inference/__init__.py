"""From frames, prior and likelihood to a stream of steps."""
