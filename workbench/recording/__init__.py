"""Runs written as Rerun recordings; the only package that imports rerun."""

import os

# What its writer cannot do ends the run, which says so; read when rerun is imported.
os.environ.setdefault("RUST_LOG", "warn,re_log_encoding=off,re_sdk=off")

# Its allocator gives back what is free at once, not after seconds, which takes no longer: a third less for a long run.
os.environ.setdefault("MIMALLOC_PURGE_DELAY", "0")
