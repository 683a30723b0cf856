"""The seams of the workbench: what the parts of a run hand to each other. Their words: .docs/start/concepts.md."""
