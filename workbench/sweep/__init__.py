"""Sweeps over configurations: their plan, their jobs, which Hydra's launchers run, and the table of them."""
