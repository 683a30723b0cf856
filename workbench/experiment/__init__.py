"""One run: its configuration checked, its parts built, tracked and recorded."""
