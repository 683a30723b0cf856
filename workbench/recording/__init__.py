"""Runs written as Rerun recordings; the only package that imports rerun."""

import os

# What its writer cannot do ends the run, which says so; read when rerun is imported.
os.environ.setdefault("RUST_LOG", "warn,re_log_encoding=off,re_sdk=off")
