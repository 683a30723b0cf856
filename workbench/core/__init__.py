"""The seams of the workbench: what the parts of a run hand to each other; their words are in .docs/start/concepts.md."""
