"""The verdict on a run: its measurements, the findings on them, and whether the person was tracked."""
