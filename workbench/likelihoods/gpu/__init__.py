"""Several cues judged by one NVIDIA GPU, for many more particles than a processor has time for."""
