"""Hydra configuration files, installed as the package workbench.conf."""
