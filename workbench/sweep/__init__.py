"""Sweeps over configurations: plan, jobs (run by Hydra's launchers) and table."""
